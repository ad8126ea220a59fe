//! The visible part of the vehicle that carries the sensor: its roof, deck or cab hides objects behind it. It moves with the sensor.

use super::mesh::{METAL, Mesh, RUBBER, solid, up, v};
use super::{footprint::Footprint, ground::Ground, place::ROBOT_M, random::Dice};
use mluc_model::SensorProfile;

/// Ground of a car without a visible body, with free space ahead of it, m.
pub(crate) const CAR: Footprint = Footprint::ahead(0.5, [3.5, 1.3]);
/// The same for a small robot, m.
const ROBOT: Footprint = Footprint::ahead(0.2, [0.9, 0.6]);
/// Chance that the sensor sees its own vehicle: a guess.
const SEEN: f32 = 0.45;
/// From this height of the sensor on the vehicle is a truck, m.
const TRUCK_M: f32 = 2.2;

/// The body in the sensor frame, empty when it is not visible, and the ground that it takes.
pub(crate) struct Ego {
    pub(crate) mesh: Mesh,
    pub(crate) footprint: Footprint,
}

impl Ego {
    /// Draws the body under the sensor.
    pub(crate) fn draw(profile: &SensorProfile, ground: &Ground, dice: &mut Dice) -> Ego {
        let (mut mesh, height_m) = (Mesh::default(), -ground.height(0.0, 0.0));
        let footprint = if height_m < ROBOT_M { ROBOT } else { CAR };
        // A profile with blind sectors already states what the body hides.
        if !profile.blind.is_empty() || !dice.chance(SEEN) {
            return Ego { mesh, footprint };
        }
        // Several sensors are mounted around a body: it stays below the lowest sensor.
        let lowest_m = profile.units.iter().map(|u| u.at_m[2]).fold(0.0, f32::min);
        let is_one = profile.units.len() < 2;
        let below = |gap_m: f32| lowest_m - gap_m;
        if height_m < ROBOT_M {
            let top = below(dice.range(0.08, 0.3));
            robot(&mut mesh, height_m, top, is_one, dice);
        } else if height_m < TRUCK_M {
            car(&mut mesh, height_m, below(dice.range(0.22, 0.65)), dice);
        } else {
            let has_box = is_one && ground.room.is_none();
            let top = below(dice.range(0.25, 0.7));
            truck(&mut mesh, height_m, top, has_box, dice);
        }
        if is_one && dice.chance(0.3) {
            for _ in 0..dice.whole(1, 2) {
                mast(&mut mesh, height_m, dice);
            }
        }
        let (low, high) = mesh.bounds();
        let margin = v(0.3, 0.3, 0.0);
        let footprint = Footprint::of(low - margin, high + margin, [0.0, 0.0], 0.0);
        Ego { mesh, footprint }
    }
}

/// A deck or a box on wheels, sometimes with a load behind the sensor.
fn robot(mesh: &mut Mesh, height_m: f32, top: f32, is_one: bool, dice: &mut Dice) {
    let paint = solid(dice.range(0.08, 0.6));
    let size = dice.size([0.4, 1.1], [0.35, 0.75], [0.12, 0.5]);
    let bottom = (top - size.z).max(0.06 - height_m);
    let top = top.max(bottom + 0.04);
    // The sensor sits in the middle of the deck, or at its front.
    let middle = v(-size.x * dice.range(0.0, 0.45), 0.0, (top + bottom) / 2.0);
    mesh.block(middle, v(size.x, size.y, top - bottom), paint);
    for (x, y) in [(0.4, 0.52), (0.4, -0.52), (-0.4, 0.52), (-0.4, -0.52)] {
        let hub = v(middle.x + x * size.x, y * size.y, 0.12 - height_m);
        mesh.rod([hub, hub + v(0.0, 0.08 * y.signum(), 0.0)], 0.12, 8, RUBBER);
    }
    if is_one && dice.chance(0.3) {
        let (width, height) = (size.y * dice.range(0.3, 0.9), dice.range(0.2, 0.7));
        let load = v(size.x * 0.3, width, height);
        let at = v(middle.x - size.x * 0.35, 0.0, top + load.z / 2.0);
        mesh.block(at, load, solid(dice.range(0.1, 0.6)));
    }
}

/// Hull, cabin and sometimes bars: the sensor is on the roof, or over the bonnet.
fn car(mesh: &mut Mesh, height_m: f32, top: f32, dice: &mut Dice) {
    let paint = solid(dice.range(0.06, 0.7));
    let roof = top.min(1.9 - height_m);
    let waist = (roof - 0.5).min(0.95 - height_m);
    let length = dice.range(3.8, 4.9);
    let width = dice.range(1.65, 1.95);
    let cabin = dice.range(1.8, 2.7);
    let middle = v(dice.range(-1.0, 0.7), dice.spread(0.15), 0.0);
    let hull = v(length, width, waist - (0.25 - height_m));
    mesh.tapered(middle + up(waist - hull.z / 2.0), hull, [0.97, 0.93], paint);
    let house = v(cabin * 1.25, width * 0.93, roof - waist);
    let at = middle + v(-0.2, 0.0, (roof + waist) / 2.0);
    mesh.tapered(at, house, [0.8, 0.82], paint);
    if roof < -0.35 && dice.chance(0.5) {
        for x in [-0.4, 0.5] {
            let side = v(0.0, width * 0.42, 0.0);
            let bar = at + v(x, 0.0, (roof - waist) / 2.0 + 0.03);
            mesh.rod([bar - side, bar + side], 0.025, 6, METAL);
        }
    }
}

/// A cab below the sensor with the cargo box behind it, or the whole truck next to the sensor.
fn truck(mesh: &mut Mesh, height_m: f32, mut top: f32, has_box: bool, dice: &mut Dice) {
    let paint = solid(dice.range(0.1, 0.7));
    let width = dice.range(2.2, 2.5);
    let beside = has_box && dice.chance(0.4);
    if beside {
        top = dice.range(2.5, 3.3) - height_m;
    }
    let mut middle = v(dice.range(-1.0, -0.2), 0.0, 0.0);
    if beside {
        middle.y = dice.sign() * (width / 2.0 + dice.range(0.15, 0.5));
    }
    let bottom = 0.5 - height_m;
    let cab = v(2.1, width, top - bottom);
    mesh.tapered(middle + up((top + bottom) / 2.0), cab, [0.93, 0.96], paint);
    if has_box && (beside || dice.chance(0.7)) {
        let length = dice.range(3.0, 7.0);
        let high = dice.range(2.6, 3.9) - height_m;
        let cargo = v(length, width + 0.05, high - bottom - 0.4);
        let at = middle + v(-1.25 - length / 2.0, 0.0, high - cargo.z / 2.0);
        mesh.block(at, cargo, solid(dice.range(0.2, 0.7)));
    }
}

/// A thin rod next to the sensor: an antenna, a camera's post.
fn mast(mesh: &mut Mesh, height_m: f32, dice: &mut Dice) {
    let (sin, cos) = dice.spread(std::f32::consts::PI).sin_cos();
    let away = dice.range(0.15, 0.6);
    let at = v(away * cos, away * sin, 0.0);
    let below = -dice.range(0.1, 0.6).min(height_m - 0.1);
    let ends = [below, dice.range(0.05, 0.9)].map(|z| at + up(z));
    mesh.rod(ends, dice.range(0.008, 0.03), 6, METAL);
}
