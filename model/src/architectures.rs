//! The two architectures: `second` (the paper's) and `compact` (for a few CPU cores); `architectures.json` lists their layers.

use crate::network::{Grid, Network};
use serde::Deserialize;
use std::collections::BTreeMap;

/// Grids and networks by name; the networks of the file have KITTI's grids and its three classes.
#[derive(Deserialize)]
struct Tables {
    grids: BTreeMap<String, Grid>,
    networks: BTreeMap<String, Network>,
}

fn tables() -> Tables {
    serde_json::from_str(include_str!("architectures.json")).expect("the tables of architectures")
}

impl Grid {
    fn named(name: &str) -> Grid {
        tables().grids.remove(name).expect("a grid of the table")
    }
    /// KITTI's range with `second`'s voxels.
    pub fn kitti_second() -> Grid {
        Grid::named("kitti_second")
    }
    /// KITTI's range with `compact`'s voxels.
    pub fn kitti_compact() -> Grid {
        Grid::named("kitti_compact")
    }
    /// UDI's range; `second` and `compact` share its voxels.
    pub fn udi() -> Grid {
        Grid::named("udi")
    }
    /// A grid all around, for any sensor: z is the height above the ground.
    pub fn any() -> Grid {
        Grid::named("any")
    }
}

impl Network {
    fn named(name: &str, grid: Grid, classes: usize) -> Network {
        let network = tables().networks.remove(name);
        Network { grid, classes, ..network.expect("a network of the table") }
    }

    /// The paper's network: SECOND with 8x sparse backbone, 512 feature channels.
    pub fn second(grid: Grid, classes: usize) -> Network {
        Network::named("second", grid, classes)
    }

    /// A tenth of `second`: 0.4 m cells, 128 feature channels. A grid of 8 m height gets one more flattening layer, so that z
    /// ends at 2. A cell's receptive field is 5 m to each side: enough for a car, see [`Network::with_reach_of_trucks`].
    pub fn compact(grid: Grid, classes: usize) -> Network {
        let mut network = Network::named("compact", grid, classes);
        if network.grid.sparse_shape()[0] <= 21 {
            network.sparse.retain(|l| l.name != "backbone3d.conv4");
        }
        network
    }

    /// Adds two layers to `block2`, where every layer widens a cell's receptive field by 0.8 m to each side: to 6.65 m, so that
    /// the cell in the middle of a truck (up to 13.5 m long) sees both of its ends. Costs a sixth of `compact`'s time.
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
        let kitti = Network::compact(Grid::kitti_compact(), 3);
        assert_eq!(last(&kitti), [2, 200, 176]);
        let udi = Network::compact(Grid::udi(), 4);
        assert_eq!((last(&udi), udi.map_channels()), ([2, 256, 256], 96));
        let second = Network::second(Grid::udi(), 4);
        assert_eq!(second.map_shape(), [128, 128]);
    }
}
