//! The sensor of a `sim-any` frame: a real product or a random sensor, and its mounting.

use super::{mesh::v, place::ROBOT_M, random::Dice, sensor::Motion, sensor::Sensor};
use mluc_model::{SensorProfile, SensorUnit};

/// Products that training never sees, with few, medium and many beams: for figures on sensors that are new to a network.
const HELD_OUT: [&str; 3] = ["helios-16p", "pandar40p", "ruby-plus"];
/// Maximum number of rays in a frame of a drawn sensor: finer azimuth steps are coarsened to it.
const RAYS_MAX: f32 = 230_000.0;
/// Maximum number of columns in a frame.
const COLUMNS_MAX: f32 = 4000.0;
/// Standard deviation of a unit's elevations from the nominal values, degrees.
pub(crate) const JITTER_DEG: f32 = 0.12;

/// A product or a random sensor, with a mounting.
pub(crate) fn sensor(dice: &mut Dice) -> SensorProfile {
    let draw: fn(&mut Dice) -> SensorProfile = if dice.chance(0.6) { product } else { random };
    let mut profile = draw(dice);
    if dice.chance(0.08) {
        lose_beams(&mut profile, dice);
    }
    if dice.chance(0.1) {
        let beams = profile.elevations_deg.len();
        let most = if beams > 40 { 2 } else { 4 };
        let count = dice.whole(2, most);
        profile.units = (0..count).map(|_| unit(dice)).collect();
    } else if dice.chance(0.08) {
        profile.field_deg = Some([dice.spread(60.0), dice.range(70.0, 270.0)]);
        profile.azimuth_step_deg *= dice.range(0.4, 1.0);
    }
    let beams = profile.elevations_deg.len() * profile.units.len().max(1);
    let width_deg = profile.field_deg.map_or(360.0, |[_, width]| width);
    let step_min_deg = width_deg * (beams as f32 / RAYS_MAX).max(1.0 / COLUMNS_MAX);
    profile.azimuth_step_deg = profile.azimuth_step_deg.max(step_min_deg);
    profile.height_m = Some(height_m(dice));
    profile
}

/// Rays of a turn: beams of all units times columns.
pub fn rays(profile: &SensorProfile) -> f32 {
    let beams = profile.elevations_deg.len() * profile.units.len().max(1);
    let width_deg = profile.field_deg.map_or(360.0, |[_, width]| width);
    beams as f32 * width_deg / profile.azimuth_step_deg
}

/// Some sensors move while they turn (low ones, on robots, slowly), unless `stays`: where they see their own vehicle, which would move with them.
/// Some report second returns. Half of the drawn sector sensors have waving lines: slow and small, as in a mirror raster, or crossing each other.
pub(crate) fn in_use(
    sensor: &mut Sensor,
    is_drawn: bool,
    stays: bool,
    height_m: f32,
    dice: &mut Dice,
) {
    let fastest_mps = if height_m < ROBOT_M { 2.0 } else { 15.0 };
    let motion = Motion {
        velocity_mps: v(dice.range(0.0, fastest_mps), 0.0, 0.0),
        yaw_rate_radps: dice.normal(0.0, 0.15),
        labels_at_end: false,
    };
    let moves = dice.chance(0.4) && !stays;
    sensor.motion = moves.then_some(motion);
    sensor.second_returns = if dice.chance(0.15) { 0.5 } else { 0.0 };
    if is_drawn && sensor.is_sector() && dice.chance(0.5) {
        let is_rosette = dice.chance(0.5);
        let [high_deg, often] = [[2.0, 6.0], [12.0, 150.0]][usize::from(is_rosette)];
        let height_rad = dice.range(0.2, high_deg).to_radians();
        sensor.wave(height_rad, dice.range(0.5 * often, often), is_rosette);
    }
}

/// Height of the sensor: mostly on cars, also on small robots and on trucks.
pub(crate) fn height_m(dice: &mut Dice) -> f32 {
    match dice.weighted(&[0.66, 0.2, 0.14]) {
        0 => dice.range(1.35, 2.2),
        1 => dice.range(0.3, 1.35),
        _ => dice.range(2.2, 3.0),
    }
}

/// One of the products, with fixed shares for few, medium and many beams.
fn product(dice: &mut Dice) -> SensorProfile {
    let [low, high] = [[0, 16], [17, 47], [48, 256]][dice.weighted(&[0.3, 0.3, 0.4])];
    let profiles = SensorProfile::names().filter(|name| !HELD_OUT.contains(name));
    let profiles = profiles.filter_map(|name| SensorProfile::load(name).ok());
    // Sensors without downward beams are normally mounted tilted, which is not simulated. Sectors and waves are drawn separately.
    let looks_down = |p: &SensorProfile| p.elevations_deg.iter().any(|e| *e < -4.0);
    let spins = |p: &SensorProfile| p.field_deg.is_none() && p.wave.is_none();
    let fits = |p: &SensorProfile| {
        (low..=high).contains(&p.elevations_deg.len()) && looks_down(p) && spins(p)
    };
    let mut fitting: Vec<SensorProfile> = profiles.filter(fits).collect();
    fitting.swap_remove(dice.whole(0, fitting.len() - 1))
}

/// Beams spread evenly, or denser near the horizon.
fn random(dice: &mut Dice) -> SensorProfile {
    let beams = [dice.whole(8, 16), dice.whole(20, 48), dice.whole(56, 128)];
    let beams = beams[dice.weighted(&[0.35, 0.35, 0.3])];
    let (top, bottom) = (dice.range(1.0, 25.0), -dice.range(8.0, 32.0));
    let crowds = dice.chance(0.5);
    let crowding = if crowds { dice.range(1.0, 2.2) } else { 1.0 };
    let horizon = dice.range(-4.0, 2.0).min(top - 0.5);
    let elevation = |b: usize| {
        // -1 at the bottom, 1 at the top.
        let t = 1.0 - 2.0 * b as f32 / (beams - 1) as f32;
        let (above, below) = (top - horizon, horizon - bottom);
        let end = if t > 0.0 { above } else { below };
        horizon + end * t.signum() * t.abs().powf(crowding)
    };
    SensorProfile {
        name: format!("random, {beams} beams"),
        source: "drawn".into(),
        elevations_deg: (0..beams).map(elevation).collect(),
        azimuth_step_deg: dice.range(0.1, 0.6),
        range_m: [dice.range(0.3, 1.0), dice.range(60.0, 200.0)],
        range_noise_m: dice.range(0.01, 0.04),
        ..SensorProfile::default()
    }
}

/// Removes some beams: broken, or dropped by a driver.
fn lose_beams(profile: &mut SensorProfile, dice: &mut Dice) {
    let share = dice.range(0.05, 0.3);
    let kept: Vec<bool> = profile.elevations_deg.iter().map(|_| !dice.chance(share)).collect();
    if kept.iter().filter(|kept| **kept).count() < 6 {
        return;
    }
    for list in [
        &mut profile.elevations_deg,
        &mut profile.azimuth_offsets_deg,
        &mut profile.origin_heights_m,
    ] {
        let mut kept = kept.iter();
        list.retain(|_| *kept.next().unwrap_or(&true));
    }
}

/// One of several units on a vehicle.
fn unit(dice: &mut Dice) -> SensorUnit {
    SensorUnit {
        at_m: [dice.spread(1.5), dice.spread(0.8), dice.spread(0.25)],
        yaw_deg: dice.spread(180.0),
        pitch_deg: dice.normal(0.0, 5.0),
        roll_deg: dice.normal(0.0, 5.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sensors_of_every_density_and_height_are_drawn_and_none_that_is_held_out() {
        let drawn: Vec<SensorProfile> = (0..400).map(|i| sensor(&mut Dice::new(&[i]))).collect();
        let count =
            |test: &dyn Fn(&SensorProfile) -> bool| drawn.iter().filter(|p| test(p)).count();
        let beams = |p: &SensorProfile| p.elevations_deg.len();
        assert!(count(&|p| beams(p) <= 16) > 80 && count(&|p| beams(p) >= 48) > 80);
        assert!(count(&|p| p.height_m < Some(1.0)) > 20 && count(&|p| p.height_m > Some(2.2)) > 20);
        assert!(count(&|p| p.units.len() > 1) > 15 && count(&|p| p.field_deg.is_some()) > 10);
        let held_out = HELD_OUT.map(|name| SensorProfile::load(name).expect(name).name);
        assert_eq!(count(&|p| held_out.contains(&p.name)), 0);
        for p in &drawn {
            assert!(rays(p) < 1.01 * RAYS_MAX, "{p:?}");
            assert!(p.elevations_deg.is_sorted_by(|a, b| a >= b), "{p:?}");
        }
    }
}
