//! Sequences: the scene of a frame in several turns, a tenth of a second apart, while the sensor and some objects move.

use super::mesh::{V3, v};
use super::{Class, Turn, footprint::Footprint, layout::Layout, objects::Habit, random::Dice};

/// Time between two turns of the sensor, s.
const PERIOD_S: f32 = 0.1;
/// The sensor's maximum way, m: the ground ends 90 m ahead.
const WAY_MAX_M: f32 = 60.0;
/// Margin around a moving thing, m.
const CLEAR_M: f32 = 0.3;

/// Moves the objects to their position at a turn. Returns the sensor's position in the sensor frame of turn 0, and its velocity (m/s). Heading and
/// height above the ground stay. All move straight ahead, at speeds that avoid any collision in the whole sequence.
pub(crate) fn drive(layout: &mut Layout<'_>, turn: Turn, dice: &mut Dice) -> [V3; 2] {
    let (seconds, ground) = (PERIOD_S * turn.steps as f32, layout.ground);
    // Everything that takes ground: the sensor's own vehicle, then the objects in their order, then the background.
    let (taken, mut swept) = (&layout.taken, layout.taken.clone());
    let mut clear_speed = |index: usize, yaw: f32, wanted_mps: f32| {
        let mut speeds = [1.0, 0.5, 0.25].into_iter().map(|share| wanted_mps * share);
        let clear = speeds.find(|speed| {
            let path = along(&taken[index], yaw, speed * seconds);
            let mut others = swept[..index].iter().chain(&swept[index + 1..]);
            let is_clear = !others.any(|other| path.overlaps(other, CLEAR_M));
            if is_clear {
                swept[index] = path;
            }
            is_clear
        });
        clear.unwrap_or(0.0)
    };
    let way_m = |speed_mps: f32| speed_mps * PERIOD_S * turn.step as f32;
    let wanted_mps = dice.range(3.0, 12.0).min(WAY_MAX_M / seconds);
    let ego_mps = clear_speed(0, ground.yaw_rad, wanted_mps);
    for (index, object) in layout.placed.iter_mut().enumerate() {
        let wanted_mps = match object.class {
            Class::Pedestrian => dice.range(0.6, 1.8),
            Class::Cyclist => dice.range(2.0, 6.0),
            Class::Car | Class::Van | Class::Truck => dice.range(3.0, 14.0),
            Class::Unseen(class) if class.habit() == Habit::Still => 0.0,
            _ => dice.range(1.0, 5.0),
        };
        if dice.chance(0.5) {
            let at = &mut object.footprint;
            let way_m = way_m(clear_speed(index + 1, at.yaw, wanted_mps));
            at.x += way_m * at.yaw.cos();
            at.y += way_m * at.yaw.sin();
        }
    }
    let at = |step: f32| {
        let way_m = ego_mps * PERIOD_S * step;
        let (x, y) = (way_m * ground.yaw_rad.cos(), way_m * ground.yaw_rad.sin());
        v(x, y, ground.height(x, y) - ground.height(0.0, 0.0))
    };
    let step = turn.step as f32;
    [at(step), (at(step) - at(step - 1.0)) / PERIOD_S]
}

/// The ground that a thing covers on its way straight ahead.
fn along(start: &Footprint, yaw: f32, way_m: f32) -> Footprint {
    // The sensor's vehicle is aligned with x of its frame but follows the road; the difference is a few degrees.
    Footprint {
        x: start.x + 0.5 * way_m * yaw.cos(),
        y: start.y + 0.5 * way_m * yaw.sin(),
        yaw,
        half: [start.half[0] + 0.5 * way_m, start.half[1]],
    }
}
