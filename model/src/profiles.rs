//! The two profiles: `second` (the paper's) and `compact` (for a few CPU cores).

use crate::network::{DenseLayer, Grid, HeadKind, Network, SparseLayer, UpLayer, VoxelInput};

fn submanifold(name: &str, cin: usize, cout: usize) -> SparseLayer {
    SparseLayer {
        name: format!("backbone3d.{name}"),
        submanifold: true,
        kernel: [3; 3],
        stride: [1; 3],
        padding: [1; 3],
        cin,
        cout,
    }
}

fn strided(name: &str, padding: [usize; 3], cin: usize, cout: usize) -> SparseLayer {
    SparseLayer {
        submanifold: false,
        stride: [2; 3],
        padding,
        ..submanifold(name, cin, cout)
    }
}

/// Kernel (3, 1, 1), stride (2, 1, 1): halves the height alone.
fn flatten(name: &str, cin: usize, cout: usize) -> SparseLayer {
    SparseLayer {
        submanifold: false,
        kernel: [3, 1, 1],
        stride: [2, 1, 1],
        padding: [0; 3],
        ..submanifold(name, cin, cout)
    }
}

fn block(name: &str, layers: usize, stride: usize, cin: usize, cout: usize) -> Vec<DenseLayer> {
    (0..layers)
        .map(|i| DenseLayer {
            name: format!("backbone2d.{name}.{i}"),
            stride: if i == 0 { stride } else { 1 },
            cin: if i == 0 { cin } else { cout },
            cout,
        })
        .collect()
}

fn up(name: &str, factor: usize, cin: usize, cout: usize) -> UpLayer {
    UpLayer {
        name: format!("backbone2d.{name}"),
        factor,
        cin,
        cout,
    }
}

impl Grid {
    /// KITTI's range with `second`'s voxels.
    pub fn kitti_second() -> Grid {
        Grid {
            range_min_m: [0.0, -40.0, -3.0],
            range_max_m: [70.4, 40.0, 1.0],
            voxel_size_m: [0.05, 0.05, 0.1],
            points_per_voxel_max: 5,
            voxels_max: 40_000,
        }
    }
    /// KITTI's range with `compact`'s voxels.
    pub fn kitti_compact() -> Grid {
        Grid {
            voxel_size_m: [0.1, 0.1, 0.2],
            voxels_max: 60_000,
            ..Grid::kitti_second()
        }
    }
    /// UDI's range; `second` and `compact` share its voxels.
    pub fn udi() -> Grid {
        Grid {
            range_min_m: [-51.2, -51.2, -5.0],
            range_max_m: [51.2, 51.2, 3.0],
            voxel_size_m: [0.1, 0.1, 0.2],
            points_per_voxel_max: 10,
            voxels_max: 60_000,
        }
    }
    /// All around, for any sensor: z is the height above the ground.
    pub fn any() -> Grid {
        Grid {
            range_min_m: [-51.2, -51.2, -0.8],
            range_max_m: [51.2, 51.2, 3.2],
            ..Grid::udi()
        }
    }
}

impl Network {
    /// The paper's network: SECOND with 8x sparse backbone, 512 feature channels.
    pub fn second(grid: Grid, classes: usize) -> Network {
        Network {
            profile: "second".into(),
            grid,
            input: VoxelInput::default(),
            sparse: vec![
                submanifold("conv_input", 4, 16),
                submanifold("conv1.0", 16, 16),
                strided("conv2.0", [1; 3], 16, 32),
                submanifold("conv2.1", 32, 32),
                submanifold("conv2.2", 32, 32),
                strided("conv3.0", [1; 3], 32, 64),
                submanifold("conv3.1", 64, 64),
                submanifold("conv3.2", 64, 64),
                strided("conv4.0", [0, 1, 1], 64, 64),
                submanifold("conv4.1", 64, 64),
                submanifold("conv4.2", 64, 64),
                flatten("conv_out", 64, 128),
            ],
            block1: block("block1", 6, 1, 256, 128),
            block2: block("block2", 6, 2, 128, 256),
            up1: up("up1", 1, 128, 256),
            up2: up("up2", 2, 256, 256),
            classes,
            head: HeadKind::default(),
            generic: 0,
        }
    }

    /// A tenth of `second`: 0.4 m cells, 128 feature channels. A grid of 8 m height gets one more flattening layer, so
    /// that z ends at 2. A cell sees 5 m to each side: enough for a car, see [`Network::with_reach_of_trucks`].
    pub fn compact(grid: Grid, classes: usize) -> Network {
        let mut sparse = vec![
            submanifold("conv_input", 4, 16),
            strided("conv2.0", [1; 3], 16, 32),
            submanifold("conv2.1", 32, 32),
            strided("conv3.0", [1; 3], 32, 48),
            submanifold("conv3.1", 48, 48),
        ];
        if grid.sparse_shape()[0] > 21 {
            sparse.push(flatten("conv4", 48, 48));
        }
        sparse.push(flatten("conv_out", 48, 48));
        Network {
            profile: "compact".into(),
            sparse,
            block1: block("block1", 3, 1, 96, 48),
            block2: block("block2", 4, 2, 48, 96),
            up1: up("up1", 1, 48, 64),
            up2: up("up2", 2, 96, 64),
            ..Network::second(grid, classes)
        }
    }

    /// Two more layers in `block2`, where every layer widens what a cell sees by 0.8 m to each side: 6.65 m, so that the
    /// cell in the middle of a truck (up to 13.5 m long) sees both of its ends. Costs a sixth of `compact`'s time.
    pub fn with_reach_of_trucks(mut self) -> Network {
        let Some(last) = self.block2.last().cloned() else {
            return self;
        };
        for _ in 0..2 {
            let mut layer = last.clone();
            layer.name = format!("backbone2d.block2.{}", self.block2.len());
            self.block2.push(layer);
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn second_on_kitti_has_the_papers_shapes() {
        let network = Network::second(Grid::kitti_second(), 3);
        let shapes = network.sparse_shapes();
        assert_eq!(shapes[0], [41, 1600, 1408]);
        assert_eq!(shapes[shapes.len() - 1], [2, 200, 176]);
        assert_eq!(network.map_channels(), 256);
        assert_eq!(network.feature_channels(), 512);
        assert_eq!(200 * 176 * network.anchors(), 211_200);
    }

    #[test]
    fn compact_ends_at_two_levels_and_second_on_udi_has_the_papers_map() {
        let last = |network: &Network| *network.sparse_shapes().last().unwrap();
        assert_eq!(
            last(&Network::compact(Grid::kitti_compact(), 3)),
            [2, 200, 176]
        );
        let udi = Network::compact(Grid::udi(), 4);
        assert_eq!((last(&udi), udi.map_channels()), ([2, 256, 256], 96));
        let second = Network::second(Grid::udi(), 4);
        assert_eq!(second.map_shape(), [128, 128]);
    }
}
