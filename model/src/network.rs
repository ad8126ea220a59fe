//! SECOND's layers as data (paper section 3.1; the sizes come from the public SECOND configurations).
//!
//! Weight shapes, row-major: sparse `(out, kz, ky, kx, in)`, dense `(out, in, 3, 3)`, up `(in, out, k, k)`, head
//! `(out, in, 1, 1)` with a bias. Every convolution but the head's has no bias and is followed by batch norm
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
    /// Maximum number of averaged points per voxel; later points are not averaged.
    pub points_per_voxel_max: u32,
    /// Maximum number of voxels. Points that would open a further voxel are left out, counted and flagged.
    pub voxels_max: u32,
}

impl Grid {
    /// Number of voxels along x, y, z.
    pub fn cells(&self) -> [usize; 3] {
        [0, 1, 2].map(|i| {
            ((self.range_max_m[i] - self.range_min_m[i]) / self.voxel_size_m[i]).round() as usize
        })
    }
    /// The same voxel size with another range in x and y, m.
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

/// The input values of a voxel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum VoxelInput {
    /// Mean x, y, z in the sensor frame, m, and intensity (the public SECOND).
    #[default]
    Absolute,
    /// Position of the points in the voxel: mean x and y from its centre, in voxels; mean height above the local ground, m; 0.
    /// The grid's z is also the height above the ground. So nothing depends on the sensor's mounting, on range or on intensity.
    Local,
}

/// One sparse 3-D convolution. Triples are z, y, x.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SparseLayer {
    /// Name, for instance `backbone3d.conv2.0`.
    pub name: String,
    /// Whether the output sites equal the input sites; if not, a site exists where any input lies in its window.
    pub submanifold: bool,
    /// For a strided layer: a site exists only at floor(site / stride) of an input, inside the output's grid (as in the Minkowski Engine).
    #[serde(default, skip_serializing_if = "is_default")]
    pub floor: bool,
    /// Taps along each axis.
    pub kernel: [usize; 3],
    /// Stride; 1 for a submanifold layer.
    pub stride: [usize; 3],
    /// Padding; kernel / 2 for a submanifold layer.
    pub padding: [usize; 3],
    /// Input channels.
    pub cin: usize,
    /// Output channels.
    pub cout: usize,
}

impl SparseLayer {
    /// Number of taps of the kernel.
    pub fn taps(&self) -> usize {
        self.kernel.iter().product()
    }
    /// Shape (z, y, x) after this layer.
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
    /// Name, for instance `backbone2d.block1.0`.
    pub name: String,
    /// Stride: 1 or 2.
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
    /// Name: `backbone2d.up1` or `backbone2d.up2`.
    pub name: String,
    /// Factor: 1 or 2.
    pub factor: usize,
    /// Input channels.
    pub cin: usize,
    /// Output channels.
    pub cout: usize,
}

/// The outputs of the 1x1 convolutions on a feature row. [`Network::heads`] lists the tensors of each kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum HeadKind {
    /// Objectness of each anchor and one embedding per cell, compared with prototypes (paper section 3.2).
    #[default]
    Metric,
    /// Objectness of each anchor and, once per cell, the logits of a softmax over the classes.
    Softmax,
    /// A logit for each anchor and class, as in the public SECOND: no object is ever unknown.
    Sigmoid,
    /// `Metric`, class-agnostic anchors, and per cell a logit of being none of the known classes: an extension of the paper.
    Open,
}

impl HeadKind {
    /// T if the kind fixes it: then 2 T f equals f, the logits.
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
    /// Architecture: `second` or `compact`.
    pub profile: String,
    /// Input grid.
    pub grid: Grid,
    /// The input values of a voxel.
    #[serde(default, skip_serializing_if = "is_default")]
    pub input: VoxelInput,
    /// The sparse layers, in order.
    pub sparse: Vec<SparseLayer>,
    /// Layers on the bird's-eye map at full size.
    pub block1: Vec<DenseLayer>,
    /// Layers at half size (the first layer has stride 2).
    pub block2: Vec<DenseLayer>,
    /// Layer on block1's output.
    pub up1: UpLayer,
    /// Layer on block2's output.
    pub up2: UpLayer,
    /// Known classes C: the embedding has C channels.
    pub classes: usize,
    /// Kind of the heads; a file omits it for the paper's kind.
    #[serde(default, skip_serializing_if = "is_default")]
    pub head: HeadKind,
    /// Number of sizes of class-agnostic anchors; only [`HeadKind::Open`] has any.
    #[serde(default, skip_serializing_if = "is_default")]
    pub generic: usize,
    /// Number of first bird's-eye layers that also compute the cells around the cells of the layer before; the other layers compute the
    /// same cells as the layer before. The remaining cells have the values of the empty scene. `None`: all layers, as in a dense network.
    #[serde(default, skip_serializing_if = "is_default")]
    pub halo_layers: Option<usize>,
}

impl Network {
    /// Shapes (z, y, x): of the input, then after every sparse layer.
    pub fn sparse_shapes(&self) -> Vec<[usize; 3]> {
        let mut shapes = vec![self.grid.sparse_shape()];
        for layer in &self.sparse {
            shapes.push(layer.output_shape(shapes[shapes.len() - 1]));
        }
        shapes
    }
    /// Maximum number of sites before the first sparse layer and after each layer. A strided layer turns a site into at most one site per window that
    /// contains it (into one with `floor`), and no level has more sites than its grid has cells.
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
    /// Number of ground heights that accompany a frame's feature rows: 0 if boxes are not measured from the ground.
    pub fn ground_nodes(&self) -> usize {
        match self.input {
            VoxelInput::Absolute => 0,
            VoxelInput::Local => mluc_geometry::ground::GROUND_NODES,
        }
    }
    /// Number of channels of the bird's-eye map; the channel of c and z is c * depth + z.
    pub fn map_channels(&self) -> usize {
        let shapes = self.sparse_shapes();
        self.sparse.last().map_or(0, |layer| layer.cout) * shapes[shapes.len() - 1][0]
    }
    /// Number of channels of a feature row: both up layers.
    pub fn feature_channels(&self) -> usize {
        self.up1.cout + self.up2.cout
    }
    /// Number of anchors per cell: two rotations per class, then per class-agnostic size, order (class, rotation).
    pub fn anchors(&self) -> usize {
        2 * (self.classes + self.generic)
    }
    /// Name and output channels of the heads. The first head decides whether an anchor is a candidate; then come the cell's embedding,
    /// 7 box codes and 2 direction bins per anchor, and the open head's unknown logit. The class head's channels are (anchor, class).
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

/// Name and output channels of every layer that has an int8 range, in the order of computation.
pub fn calibrated_layers(network: &Network) -> Vec<(String, usize)> {
    let sparse = network.sparse.iter().map(|layer| (layer.name.clone(), layer.cout));
    let dense = network.block1.iter().chain(&network.block2);
    let dense = dense.map(|layer| (layer.name.clone(), layer.cout));
    sparse.chain(dense).collect()
}
