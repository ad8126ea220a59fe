//! Sequences: the scene of a frame seen again and again, a tenth of a second apart, while the sensor and some objects move.

use super::Class;
use super::footprint::Footprint;
use super::ground::Ground;
use super::layout::Placed;
use super::mesh::{V3, v};
use super::random::Dice;

/// Time between two turns of the sensor, s.
pub(crate) const PERIOD_S: f32 = 0.1;
/// Margin that a moving thing keeps, m.
const CLEAR_M: f32 = 0.3;

/// How fast the sensor's vehicle and every object go; all go straight ahead.
pub(crate) struct Drive {
    ego_mps: f32,
    ego_yaw: f32,
    objects_mps: Vec<f32>,
}

impl Drive {
    /// Draws speeds such that in `steps` turns nothing runs into anything: `taken` is all that takes ground, the sensor's own vehicle first,
    /// then the objects in their order, then the background.
    pub(crate) fn draw(
        ground: &Ground,
        placed: &[Placed],
        taken: &[Footprint],
        steps: u32,
        dice: &mut Dice,
    ) -> Drive {
        let seconds = PERIOD_S * steps as f32;
        let mut swept = taken.to_vec();
        let mut clear_speed = |index: usize, yaw: f32, wanted_mps: f32| {
            [1.0, 0.5, 0.25].into_iter().find_map(|share| {
                let speed = wanted_mps * share;
                let path = along(&taken[index], yaw, speed * seconds);
                let is_clear = swept
                    .iter()
                    .enumerate()
                    .all(|(other, footprint)| other == index || !path.overlaps(footprint, CLEAR_M));
                is_clear.then(|| swept[index] = path)?;
                Some(speed)
            })
        };
        let ego_mps = clear_speed(0, ground.yaw_rad, dice.range(3.0, 12.0)).unwrap_or(0.0);
        let objects_mps = placed
            .iter()
            .enumerate()
            .map(|(index, object)| {
                let wanted = match object.class {
                    Class::Pedestrian => dice.range(0.6, 1.8),
                    Class::Cyclist => dice.range(2.0, 6.0),
                    Class::GolfCart | Class::Forklift | Class::SyntheticUnknown => {
                        dice.range(1.0, 5.0)
                    }
                    _ => dice.range(3.0, 14.0),
                };
                let moves = dice.chance(0.5);
                let speed = moves.then(|| clear_speed(index + 1, object.footprint.yaw, wanted));
                speed.flatten().unwrap_or(0.0)
            })
            .collect();
        Drive {
            ego_mps,
            ego_yaw: ground.yaw_rad,
            objects_mps,
        }
    }

    /// Moves the objects to where they are at turn `step`.
    pub(crate) fn move_objects(&self, step: u32, placed: &mut [Placed]) {
        for (object, speed) in placed.iter_mut().zip(&self.objects_mps) {
            let way = speed * PERIOD_S * step as f32;
            object.footprint.x += way * object.footprint.yaw.cos();
            object.footprint.y += way * object.footprint.yaw.sin();
        }
    }

    /// Where the sensor is at turn `step`, in the sensor frame of turn 0; it keeps its heading and its height above the ground.
    pub(crate) fn sensor_at(&self, step: u32, ground: &Ground) -> V3 {
        let way = self.ego_mps * PERIOD_S * step as f32;
        let (x, y) = (way * self.ego_yaw.cos(), way * self.ego_yaw.sin());
        v(x, y, ground.height(x, y) - ground.height(0.0, 0.0))
    }
}

/// All that a thing covers on its way straight ahead.
fn along(start: &Footprint, yaw: f32, way_m: f32) -> Footprint {
    // The sensor's vehicle heads along x of its frame but follows the road; the difference is a few degrees.
    Footprint {
        x: start.x + 0.5 * way_m * yaw.cos(),
        y: start.y + 0.5 * way_m * yaw.sin(),
        yaw,
        half: [start.half[0] + 0.5 * way_m, start.half[1]],
    }
}
