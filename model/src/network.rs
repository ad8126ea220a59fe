//! SECOND's layers as data (paper section 3.1; the sizes are those of the public SECOND configurations).
//!
//! Weight shapes, row-major: sparse `(out, kz, ky, kx, in)`, dense `(out, in, 3, 3)`, up `(in, out, k, k)`, head
//! `(out, in, 1, 1)` with a bias. Every convolution but the head's is free of bias and followed by batch norm
//! (`NAME.bn.weight|bias|running_mean|running_var`, eps 1e-3) and ReLU.

use serde::{Deserialize, Serialize};

/// The detection range and its voxels. All triples are x, y, z.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grid {
    /// Lower corner, m.
    pub range_min_m: [f32; 3],
    /// Upper corner, m.
    pub range_max_m: [f32; 3],
    /// Voxel edges, m.
    pub voxel_size_m: [f32; 3],
    /// Later points of a full voxel are not averaged.
    pub points_per_voxel_max: u32,
    /// Points that would open a further voxel are left out, counted and flagged.
    pub voxels_max: u32,
}

impl Grid {
    /// Voxels along x, y, z.
    pub fn cells(&self) -> [usize; 3] {
        [0, 1, 2].map(|i| {
            ((self.range_max_m[i] - self.range_min_m[i]) / self.voxel_size_m[i]).round() as usize
        })
    }
    /// The same voxels within other x and y, m.
    pub fn within(mut self, x_m: [f32; 2], y_m: [f32; 2]) -> Grid {
        for (axis, [low, high]) in [x_m, y_m].into_iter().enumerate() {
            (self.range_min_m[axis], self.range_max_m[axis]) = (low, high);
        }
        self
    }
    /// Shape of the first sparse map: z + 1, y, x.
    pub fn sparse_shape(&self) -> [usize; 3] {
        let [x, y, z] = self.cells();
        [z + 1, y, x]
    }
}

/// What a voxel tells the network.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum VoxelInput {
    /// Mean x, y, z in the sensor frame, m, and intensity (the public SECOND).
    #[default]
    Absolute,
    /// Where in the voxel its points lie: mean x and y from its centre, in voxels; mean height above the local ground, m; 0. The
    /// grid's z is the height above the ground too. So nothing depends on how a sensor is mounted, on range or on intensity.
    Local,
}

/// One sparse 3-D convolution. Triples are z, y, x.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SparseLayer {
    /// `backbone3d.conv2.0`, for instance.
    pub name: String,
    /// Output sites = input sites; else a site exists where any input lies in its window.
    pub submanifold: bool,
    /// Of a strided layer: a site exists only at floor(site / stride) of an input inside the output's grid (as in the Minkowski Engine).
    #[serde(default, skip_serializing_if = "is_default")]
    pub floor: bool,
    /// Taps.
    pub kernel: [usize; 3],
    /// 1 for submanifold.
    pub stride: [usize; 3],
    /// kernel / 2 for submanifold.
    pub padding: [usize; 3],
    /// Input channels.
    pub cin: usize,
    /// Output channels.
    pub cout: usize,
}

impl SparseLayer {
    /// Taps of the kernel.
    pub fn taps(&self) -> usize {
        self.kernel.iter().product()
    }
    /// Shape after this layer.
    pub fn output_shape(&self, input: [usize; 3]) -> [usize; 3] {
        [0, 1, 2].map(|i| {
            (input[i] + 2 * self.padding[i]).saturating_sub(self.kernel[i]) / self.stride[i] + 1
        })
    }
}

/// One 3x3 convolution with padding 1 on the bird's-eye map.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DenseLayer {
    /// `backbone2d.block1.0`, for instance.
    pub name: String,
    /// 1 or 2.
    pub stride: usize,
    /// Input channels.
    pub cin: usize,
    /// Output channels.
    pub cout: usize,
}

/// One transposed convolution, kernel = stride = `factor`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UpLayer {
    /// `backbone2d.up1` or `backbone2d.up2`.
    pub name: String,
    /// 1 or 2.
    pub factor: usize,
    /// Input channels.
    pub cin: usize,
    /// Output channels.
    pub cout: usize,
}

/// What the 1x1 convolutions on a feature row say. Tensors by kind: [`Network::heads`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum HeadKind {
    /// Objectness of each anchor and one embedding a cell, compared with prototypes (paper section 3.2).
    #[default]
    Metric,
    /// Objectness of each anchor and the logits of a softmax over the classes, once a cell.
    Softmax,
    /// A logit for each anchor and class, as in the public SECOND: nothing is ever unknown.
    Sigmoid,
    /// `Metric`, anchors without a class, and a logit a cell of being none of the known: an extension of the paper.
    Open,
}

impl HeadKind {
    /// T where the kind settles it: 2 T f is then f itself, the logits.
    pub fn prototype_scale(self) -> Option<f32> {
        matches!(self, HeadKind::Softmax | HeadKind::Sigmoid).then_some(0.5)
    }
}

pub(crate) fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// The whole network: voxels -> sparse 3-D -> bird's-eye map -> two blocks -> two ups, concatenated -> heads.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Network {
    /// `second` or `compact`.
    pub profile: String,
    /// Input grid.
    pub grid: Grid,
    /// What a voxel tells.
    #[serde(default, skip_serializing_if = "is_default")]
    pub input: VoxelInput,
    /// In order.
    pub sparse: Vec<SparseLayer>,
    /// Bird's-eye map at full size.
    pub block1: Vec<DenseLayer>,
    /// At half size (its first layer has stride 2).
    pub block2: Vec<DenseLayer>,
    /// Of block1's output.
    pub up1: UpLayer,
    /// Of block2's output.
    pub up2: UpLayer,
    /// Known classes C: the embedding has C channels.
    pub classes: usize,
    /// What the heads say; left out of a file where it is the paper's.
    #[serde(default, skip_serializing_if = "is_default")]
    pub head: HeadKind,
    /// Sizes of anchors without a class, which only [`HeadKind::Open`] has.
    #[serde(default, skip_serializing_if = "is_default")]
    pub generic: usize,
    /// The first so many bird's-eye layers also compute the cells around those that the layer before computed; the others
    /// compute the same cells, and the rest is the empty scene's. `None`: all do, as a dense network.
    #[serde(default, skip_serializing_if = "is_default")]
    pub halo_layers: Option<usize>,
}

impl Network {
    /// Shape (z, y, x) after every sparse layer, the input's first.
    pub fn sparse_shapes(&self) -> Vec<[usize; 3]> {
        let mut shapes = vec![self.grid.sparse_shape()];
        for layer in &self.sparse {
            shapes.push(layer.output_shape(shapes[shapes.len() - 1]));
        }
        shapes
    }
    /// Most sites before the first sparse layer and after each: a strided layer turns a site into at most so many as the windows that hold it (one with
    /// `floor`), and no level has more than its grid.
    pub fn sites_max(&self) -> Vec<usize> {
        let shapes = self.sparse_shapes();
        let cells = |shape: &[usize; 3]| shape.iter().product::<usize>();
        let mut most = vec![cells(&shapes[0]).min(self.grid.voxels_max as usize)];
        for (layer, shape) in self.sparse.iter().zip(&shapes[1..]) {
            let windows = |axis: usize| layer.kernel[axis].div_ceil(layer.stride[axis]);
            let before = most[most.len() - 1];
            most.push(if layer.submanifold || layer.floor {
                before
            } else {
                cells(shape).min(before.saturating_mul((0..3).map(windows).product()))
            });
        }
        most
    }
    /// Bird's-eye map: rows (y), columns (x).
    pub fn map_shape(&self) -> [usize; 2] {
        let shapes = self.sparse_shapes();
        let [_, y, x] = shapes[shapes.len() - 1];
        [y, x]
    }
    /// Heights of the ground that go with a frame's feature rows: none where boxes are not measured from it.
    pub fn ground_nodes(&self) -> usize {
        match self.input {
            VoxelInput::Absolute => 0,
            VoxelInput::Local => mluc_geometry::ground::GROUND_NODES,
        }
    }
    /// Channels of the bird's-eye map: c * depth + z.
    pub fn map_channels(&self) -> usize {
        let shapes = self.sparse_shapes();
        self.sparse.last().map_or(0, |layer| layer.cout) * shapes[shapes.len() - 1][0]
    }
    /// Channels of a feature row: both ups.
    pub fn feature_channels(&self) -> usize {
        self.up1.cout + self.up2.cout
    }
    /// Anchors of a cell: two rotations a class and then a size without a class, order (class, rotation).
    pub fn anchors(&self) -> usize {
        2 * (self.classes + self.generic)
    }
    /// Name and output channels of the heads: what makes an anchor a candidate first, then what is said of the cell,
    /// then 7 box codes and 2 direction bins an anchor. The class head's channels are (anchor, class).
    pub fn heads(&self) -> Vec<(&'static str, usize)> {
        let (anchors, classes) = (self.anchors(), self.classes);
        let mut heads = match self.head {
            HeadKind::Sigmoid => vec![("head.class", anchors * classes)],
            _ => vec![("head.objectness", anchors), ("head.embedding", classes)],
        };
        heads.extend([("head.box", 7 * anchors), ("head.direction", 2 * anchors)]);
        if self.head == HeadKind::Open {
            heads.push(("head.unknown", 1));
        }
        heads
    }
}

/// Name and output channels of every layer that has a range, in the order of computation.
pub fn calibrated_layers(network: &Network) -> Vec<(String, usize)> {
    let sparse = network.sparse.iter();
    let sparse = sparse.map(|layer| (layer.name.clone(), layer.cout));
    let dense = network.block1.iter().chain(&network.block2);
    let dense = dense.map(|layer| (layer.name.clone(), layer.cout));
    sparse.chain(dense).collect()
}
