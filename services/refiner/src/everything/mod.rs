//! Whole-frame mode: every cluster that stands on the ground, without proposals.
//!
//! One pass sorts the scan into cells of 1 m, planes every 8 m tell ground from what stands on it, cells of 25 cm that
//! lie within the join distance of each other are united, and what is larger than a road user is divided by shorter
//! reaches, at last by cutting. Each cluster gets the box of the mode `distance`, its outline, its points and
//! measurements that a classifier may want. Same rules as for a candidate, so a cluster is the same whoever asks.

mod cells;
mod cluster;
mod divide;
mod measure;
mod places;

pub use cluster::{FrameCluster, FrameClusters, FrameCounters};
pub use measure::Measures;

use mluc_ipc_types::Point;

use crate::cluster::Distance;
use crate::frame::FrameIndex;
use crate::ground_map::GroundMap;
use crate::recipe::Recipe;
use crate::{Mode, RefinerError, Sensor, Settings};
use cells::Cells;
use cluster::Shaper;
use divide::Divider;

/// No cluster.
pub const NO_CLUSTER: u32 = u32::MAX;

/// Finds every cluster of frame after frame; all buffers are made once.
#[derive(Debug)]
pub struct Everything {
    settings: Settings,
    sensor_height_m: f64,
    height_max_m: f32,
    distance: Distance,
    frame: FrameIndex,
    ground: GroundMap,
    cells: Cells,
    divider: Divider,
    shaper: Shaper,
}

impl Everything {
    /// From the settings of the mode `distance`, whatever mode they name. Refuses settings that make no sense.
    pub fn new(settings: &Settings, sensor: &Sensor) -> Result<Everything, RefinerError> {
        settings.check()?;
        let settings = Settings {
            mode: Mode::Distance,
            ..settings.clone()
        };
        let recipe = Recipe::of(&settings, sensor);
        Ok(Everything {
            sensor_height_m: sensor.height_m,
            height_max_m: recipe.height_max_m as f32,
            distance: Distance::new(&settings.distance),
            frame: FrameIndex::default(),
            ground: GroundMap::default(),
            cells: Cells::default(),
            divider: Divider::new(&recipe, &settings),
            shaper: Shaper::new(recipe, sensor),
            settings,
        })
    }

    /// All clusters of one scan, the ones with most points first.
    ///
    /// Points that are not finite, beyond 128 m or beyond the contract's limit are left out and counted.
    pub fn find(&mut self, points: &[Point], out: &mut FrameClusters) {
        out.clear();
        self.frame.start();
        self.frame.want_all();
        self.frame.sort(points);
        self.ground
            .fit(&self.frame, self.sensor_height_m, &self.settings.ground);
        out.counters.points_not_finite = self.frame.not_finite;
        out.counters.points_outside = self.frame.outside;
        self.collect_standing(out);
        let join_m = |range_m| self.distance.join_distance_m(range_m);
        self.divider
            .divide(&mut self.cells, join_m, &mut out.counters);
        self.shaper
            .shape(points, &self.cells, &self.divider, &self.ground, out);
    }

    /// The ground of the last frame.
    pub fn ground(&self) -> &GroundMap {
        &self.ground
    }

    fn collect_standing(&mut self, out: &mut FrameClusters) {
        let (low, high) = (self.settings.ground.clearance_m as f32, self.height_max_m);
        let counters = &mut out.counters;
        self.cells.clear();
        let cells = &mut self.cells;
        self.ground.for_each_height(&self.frame, |point, height| {
            if height < low {
                counters.points_ground += 1;
            } else if height > high {
                counters.points_above += 1;
            } else {
                cells.add(point);
            }
        });
        self.cells.sort();
    }
}
