//! The beams of a sensor and its measurement of a range: a Velodyne HDL-64E, or any [`SensorProfile`].
//!
//! The HDL-64E of `sim-kitti` and `sim-udi`:
//!
//! Elevations: nominal values of public calibrations (upper block 2.02 - 0.34 i deg, lower block -8.95 - 0.5084 j deg, 32 beams each), with a jitter of
//! 0.05 deg per beam. Azimuth: 10 Hz, 0.1728 deg, 2083 columns per turn, own phase per beam. Range noise 2 cm, bias of 1 cm per beam, steps of 2 mm.

use super::mesh::{V3, up, v};
use super::random::{hash, normal, unit};
use mluc_geometry::Box3;
use mluc_model::{BlindSector, SensorProfile, SensorUnit};
use std::f32::consts::TAU;

const BEAMS: usize = 64;
/// Columns of a full turn of the HDL-64E at 10 Hz.
const COLUMNS: usize = 2083;
/// Shortest and longest reported range, m.
const RANGE_M: [f32; 2] = [0.9, 120.0];
/// Height above the road on KITTI's car, m.
pub(crate) const HEIGHT_M: f32 = 1.73;
/// A white surface returns half of the rays at this multiple of the longest range.
const HALF_RETURNS: f32 = 1.125;
const RANGE_STEP_M: f32 = 0.002;
const ELEVATION_JITTER_DEG: f32 = 0.05;
/// The lower block of lasers is this far below the upper one, m.
const BLOCK_OFFSET_M: f32 = 0.043;
/// Share of the HDL-64E's rays at glass that pass, and share that are lost.
const GLASS: [f32; 2] = [0.9, 0.05];

/// Measurement noise.
#[derive(Default)]
pub(crate) struct Noise {
    range_m: f32,
    beam_bias_m: f32,
    azimuth_rad: f32,
    /// Relative to the intensity.
    intensity: f32,
    /// Chance that a pulse at a depth edge is reported at or between the two surfaces.
    pub(crate) mixed: f32,
}

const NOISE: Noise = Noise {
    range_m: 0.02,
    beam_bias_m: 0.01,
    azimuth_rad: 0.02 * std::f32::consts::PI / 180.0,
    intensity: 0.1,
    mixed: 0.15,
};

/// The end of a ray.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hit {
    pub(crate) range_m: f32,
    pub(crate) cos_incidence: f32,
    pub(crate) rho: f32,
    pub(crate) instance: u16,
}

/// Beam and column of a ray; columns are counted from the first cast column.
pub(crate) type Shot = (usize, usize);

/// Streams of per-ray randomness: one number each, so that draws are independent.
#[derive(Clone, Copy)]
pub(crate) enum Stream {
    Elevation = 1,
    Phase,
    Bias,
    Range,
    Azimuth,
    Drop,
    Pass,
    Intensity,
    Mixed,
    Second,
    Wave,
    Rain,
}

/// Motion of the sensor while it turns. Points are relative to the moving sensor, as in recorded scans before any correction;
/// the frame of the scan is the sensor's frame at the end of the turn.
#[derive(Clone, Copy)]
pub(crate) struct Motion {
    /// In the frame of the scan.
    pub(crate) velocity_mps: V3,
    pub(crate) yaw_rate_radps: f32,
    /// Whether labels are at the objects' positions at the turn's end, not at their points.
    pub(crate) labels_at_end: bool,
}

/// Duration of a turn at 10 Hz, s.
const TURN_S: f32 = 0.1;

impl Motion {
    /// The sensor's position (m) and heading (sine and cosine) at a time after the turn's end.
    fn pose(self, time_s: f32) -> (V3, [f32; 2]) {
        let (sin, cos) = (self.yaw_rate_radps * time_s).sin_cos();
        (self.velocity_mps * time_s, [sin, cos])
    }
}

fn turned_by(p: V3, [sin, cos]: [f32; 2]) -> V3 {
    v(p.x * cos - p.y * sin, p.x * sin + p.y * cos, p.z)
}

/// One laser with its place in the sensor.
#[derive(Clone, Copy)]
struct Beam {
    elevation_rad: f32,
    /// Time of firing between two columns, 0..1.
    phase: f32,
    bias_m: f32,
    /// Phase of its wave at the start, 0..1.
    wave_phase: f32,
    /// Origin of its rays, m.
    origin: V3,
    /// The axes of its unit.
    axes: [V3; 3],
}

/// The axes of a unit in the frame of the scan: turned about x (roll), then y (pitch), then z (yaw).
fn axes(unit: &SensorUnit) -> [V3; 3] {
    let angles = [unit.roll_deg, unit.pitch_deg, unit.yaw_deg];
    let [(sr, cr), (sp, cp), (sy, cy)] = angles.map(|deg| deg.to_radians().sin_cos());
    [
        v(cy * cp, sy * cp, -sp),
        v(cy * sp * sr - sy * cr, sy * sp * sr + cy * cr, cp * sr),
        v(cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr),
    ]
}

/// One sensor with its values for one frame.
#[derive(Default)]
pub(crate) struct Sensor {
    pub(crate) key: u64,
    beams: Vec<Beam>,
    /// Columns of a full turn.
    columns: usize,
    first_column: usize,
    /// Number of columns that are cast.
    pub(crate) column_count: usize,
    /// Shortest and longest reported range, m.
    pub(crate) range_m: [f32; 2],
    pub(crate) noise: Noise,
    /// Maximum angular deviation of a beam, rad: tilt, and parallax at 2 m.
    stray_rad: f32,
    /// Share of the rays at glass that pass, and share that are lost there.
    pub(crate) glass: [f32; 2],
    /// Share of all hits that are lost for no visible reason.
    pub(crate) base_drop: f32,
    /// Motion while it turns; `None`: it stands still.
    pub(crate) motion: Option<Motion>,
    /// Chance that a pulse at a depth edge also returns from the farther surface.
    pub(crate) second_returns: f32,
    /// Waving lines: amplitude, rad, and number of waves per turn.
    wave: [f32; 2],
    /// Sectors that the robot's own body hides, in the sensor's own frame.
    blind: Vec<BlindSector>,
    /// The axes of the sensor's own frame in the frame of the scan, which is level.
    axes: [V3; 3],
}

impl Sensor {
    /// The sensor of a frame; with `half_turn` only the columns with x > 0 are cast.
    pub(crate) fn new(key: u64, half_turn: bool) -> Sensor {
        let draw = |stream: Stream, beam: usize| hash(&[key, stream as u64, beam as u64]);
        let beam = |b: usize| {
            let (nominal_deg, origin_z_m) = match b {
                0..32 => (2.02 - 0.34 * b as f32, 0.0),
                _ => (-8.95 - 0.5084 * (b - 32) as f32, -BLOCK_OFFSET_M),
            };
            let jitter_deg = ELEVATION_JITTER_DEG * normal(draw(Stream::Elevation, b));
            Beam {
                elevation_rad: (nominal_deg + jitter_deg).to_radians(),
                phase: unit(draw(Stream::Phase, b)),
                bias_m: NOISE.beam_bias_m * normal(draw(Stream::Bias, b)),
                wave_phase: 0.0,
                origin: up(origin_z_m),
                axes: axes(&SensorUnit::default()),
            }
        };
        let (ahead, all) = ((COLUMNS - COLUMNS / 4, COLUMNS / 2), (0, COLUMNS));
        let (first_column, column_count) = if half_turn { ahead } else { all };
        Sensor {
            key,
            beams: (0..BEAMS).map(beam).collect(),
            columns: COLUMNS,
            first_column,
            column_count,
            range_m: RANGE_M,
            noise: NOISE,
            glass: GLASS,
            base_drop: 0.01 + 0.05 * unit(draw(Stream::Drop, BEAMS)),
            ..Sensor::default()
        }
    }

    /// A profile's sensor for one frame: elevations deviate by `jitter_deg`, as between units of a type.
    pub(crate) fn of(profile: &SensorProfile, jitter_deg: f32, key: u64) -> Sensor {
        let draw = |stream: Stream, beam: usize| hash(&[key, stream as u64, beam as u64]);
        let mut noise = NOISE;
        noise.range_m = profile.range_noise_m;
        let columns = (360.0 / profile.azimuth_step_deg).round() as usize;
        let own_tilt = SensorUnit {
            pitch_deg: profile.pitch_deg,
            roll_deg: profile.roll_deg,
            ..SensorUnit::default()
        };
        let units = match &profile.units[..] {
            [] => std::slice::from_ref(&own_tilt),
            units => units,
        };
        let beams_a_unit = profile.elevations_deg.len();
        let beam = |(number, unit): (usize, &SensorUnit), b: usize| {
            let id = number * beams_a_unit + b;
            let of_beam = |list: &[f32]| list.get(b).copied().unwrap_or(0.0);
            let offset_deg = of_beam(&profile.azimuth_offsets_deg);
            let axes = axes(unit);
            let jitter_deg = jitter_deg * normal(draw(Stream::Elevation, id));
            Beam {
                elevation_rad: (profile.elevations_deg[b] + jitter_deg).to_radians(),
                phase: 0.5 + offset_deg / profile.azimuth_step_deg,
                bias_m: noise.beam_bias_m * normal(draw(Stream::Bias, id)),
                wave_phase: 0.0,
                origin: V3::from(unit.at_m) + axes[2] * of_beam(&profile.origin_heights_m),
                axes,
            }
        };
        let beams = units.iter().enumerate().flat_map(|unit| {
            let beam = &beam;
            (0..beams_a_unit).map(move |b| beam(unit, b))
        });
        let highest_m = profile.origin_heights_m.iter().map(|m| m.abs()).fold(0.0, f32::max);
        let stray_rad = units.iter().map(|unit| {
            let tilt_deg = unit.pitch_deg.abs() + unit.roll_deg.abs();
            tilt_deg.to_radians() + (V3::from(unit.at_m).length() + highest_m) / 2.0
        });
        let [middle_deg, width_deg] = profile.field_deg.unwrap_or([0.0, 360.0]);
        let share = |deg: f32| (deg / profile.azimuth_step_deg).round() as usize;
        // Recorded scans show very few points behind windows: most rays are reflected away. The returned share depends on glass and dirt.
        let passes = 0.5 * unit(draw(Stream::Pass, usize::MAX)).powi(3);
        let returns = 0.3 * unit(draw(Stream::Pass, usize::MAX - 1));
        let mut sensor = Sensor {
            key,
            beams: beams.collect(),
            columns,
            first_column: share((middle_deg - width_deg / 2.0).rem_euclid(360.0)),
            column_count: share(width_deg).min(columns),
            range_m: profile.range_m,
            stray_rad: stray_rad.fold(0.0, f32::max),
            noise,
            glass: [passes, 1.0 - passes - returns],
            base_drop: 0.01 + 0.05 * unit(draw(Stream::Drop, usize::MAX)),
            blind: profile.blind.clone(),
            axes: axes(&own_tilt),
            ..Sensor::default()
        };
        if let Some(wave) = profile.wave {
            sensor.wave(wave.height_deg.to_radians(), wave.a_turn, true);
        }
        sensor
    }

    /// Whether its field of view is less than the full circle.
    pub(crate) fn is_sector(&self) -> bool {
        self.column_count < self.columns
    }

    /// Makes the lines of a sector wave, in phase or with random phases.
    pub(crate) fn wave(&mut self, height_rad: f32, a_turn: f32, out_of_step: bool) {
        self.wave = [height_rad, a_turn];
        self.stray_rad += height_rad;
        let draw = |b| unit(hash(&[self.key, Stream::Wave as u64, b]));
        for (beam, b) in self.beams.iter_mut().zip(0..) {
            beam.wave_phase = if out_of_step { draw(b) } else { 0.0 };
        }
    }

    /// Number of beams of all units.
    pub(crate) fn beam_count(&self) -> usize {
        self.beams.len()
    }

    /// Maximum deviation of a beam from its elevation and [`Sensor::column_direction`] at an object at this distance, rad.
    pub(crate) fn stray_rad(&self, away_m: f32) -> f32 {
        let moved = self.motion.map_or(0.0, |motion| {
            TURN_S * (motion.velocity_mps.length() / away_m.max(1.0) + motion.yaw_rate_radps.abs())
        });
        self.stray_rad + moved
    }

    /// A box moved to the points on it: as seen by the sensor at this time after the turn's end.
    pub(crate) fn seen(&self, shape: Box3, time_s: f32) -> Box3 {
        let Some(motion) = self.motion else {
            return shape;
        };
        let (at, [sin, cos]) = motion.pose(time_s);
        let center = V3::from(shape.center_m.map(|c| c as f32));
        let center = turned_by(center - at, [-sin, cos]);
        Box3 {
            center_m: center.to_array().map(f64::from),
            yaw_rad: shape.yaw_rad - f64::from(sin.atan2(cos)),
            ..shape
        }
    }

    /// Random bits of one ray for one stream.
    pub(crate) fn bits(&self, stream: Stream, (beam, column): Shot) -> u64 {
        let ray = (beam * self.columns.max(4096) + column) as u64;
        hash(&[self.key ^ ((stream as u64) << 56), ray])
    }

    /// Origin and unit direction of the ray, in the frame of the scan.
    pub(crate) fn ray(&self, shot: Shot) -> (V3, V3) {
        let (start, direction) = self.ray_in_sensor(shot);
        let Some(motion) = self.motion else {
            return (start, direction);
        };
        let (at, heading) = motion.pose(self.time_s(shot.1));
        let [start, direction] = [start, direction].map(|of| turned_by(of, heading));
        (at + start, direction)
    }

    /// Whether the own body hides this ray.
    pub(crate) fn is_blind(&self, shot: Shot) -> bool {
        if self.blind.is_empty() {
            return false;
        }
        let (_, ray) = self.ray_in_sensor(shot);
        let [x, y, z] = self.axes.map(|axis| axis.dot(ray));
        let [azimuth_deg, elevation_deg] = [y.atan2(x), z.asin()].map(f32::to_degrees);
        self.blind.iter().any(|sector| sector.hides(azimuth_deg, elevation_deg))
    }

    /// Time of a column relative to the turn's end, s.
    pub(crate) fn time_s(&self, column: usize) -> f32 {
        -TURN_S * (1.0 - (column as f32 + 0.5) / self.column_count as f32)
    }

    /// The same ray in the frame of the sensor, which may move.
    pub(crate) fn ray_in_sensor(&self, shot: Shot) -> (V3, V3) {
        let beam = &self.beams[shot.0];
        let turn = ((self.first_column + shot.1) % self.columns) as f32 + beam.phase;
        let azimuth = TAU * turn / self.columns as f32
            + self.noise.azimuth_rad * normal(self.bits(Stream::Azimuth, shot));
        let (sin_a, cos_a) = azimuth.sin_cos();
        let [height_rad, a_turn] = self.wave;
        let done = TAU * (a_turn * turn / self.columns as f32 + beam.wave_phase);
        let (sin_e, cos_e) = (beam.elevation_rad + height_rad * done.sin()).sin_cos();
        let [x, y, z] = beam.axes;
        let direction = x * (cos_e * cos_a) + y * (cos_e * sin_a) + z * sin_e;
        (beam.origin, direction)
    }

    /// Elevation of a beam in its unit, rad.
    pub(crate) fn elevation_rad(&self, beam: usize) -> f32 {
        self.beams[beam].elevation_rad
    }

    /// Direction of a ray in the ground plane, without noise and tilt.
    pub(crate) fn column_direction(&self, (beam, column): Shot) -> [f32; 2] {
        let beam = &self.beams[beam];
        let turn = ((self.first_column + column) % self.columns) as f32 + beam.phase;
        let yaw_rad = beam.axes[0].y.atan2(beam.axes[0].x);
        let (sin, cos) = (TAU * turn / self.columns as f32 + yaw_rad).sin_cos();
        [cos, sin]
    }

    /// The reported range, m.
    pub(crate) fn measured(&self, range_m: f32, shot: Shot) -> f32 {
        let noise_m = self.noise.range_m * normal(self.bits(Stream::Range, shot));
        let noisy = range_m + noise_m + self.beams[shot.0].bias_m;
        (noisy / RANGE_STEP_M).round() * RANGE_STEP_M
    }

    /// Reflected intensity, 0..0.99 in steps of 0.01.
    pub(crate) fn intensity(&self, hit: &Hit, shot: Shot) -> f32 {
        let value = if hit.rho > 0.9 {
            hit.rho
        } else {
            let strays = normal(self.bits(Stream::Intensity, shot));
            hit.rho * hit.cos_incidence.max(0.0).sqrt() * (1.0 + self.noise.intensity * strays)
        };
        (value.clamp(0.0, 0.99) * 100.0).round() / 100.0
    }
}

/// Probability that a hit does not return, from range, reflectivity and cosine of incidence. The constants are guesses from published sensor models:
/// a base share of all hits (1 to 6 %, one number per frame), half of the returns at 135 sqrt(rho) m, up to 45 % more at grazing incidence.
pub(crate) fn drop_probability(sensor: &Sensor, range_m: f32, rho: f32, cos_incidence: f32) -> f32 {
    let base = sensor.base_drop;
    let half_m = HALF_RETURNS * sensor.range_m[1] * rho.sqrt();
    let far = 1.0 / (1.0 + (-(range_m - half_m) / 8.0).exp());
    let graze = 0.45 * (0.15 - cos_incidence).max(0.0) / 0.15;
    (base + far + graze).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drop_grows_with_range_and_grazing() {
        let mut sensor = Sensor::new(5, false);
        sensor.base_drop = 0.03;
        let drop = |range_m, rho, cos| drop_probability(&sensor, range_m, rho, cos);
        assert!(drop(20.0, 0.4, 1.0) < 0.05);
        assert!(drop(80.0, 0.1, 1.0) > 0.95);
        assert!(drop(20.0, 0.4, 0.01) > 10.0 * drop(20.0, 0.4, 1.0));
    }

    #[test]
    fn lines_of_a_sector_wave_together_or_each_by_itself() {
        let mut profile = SensorProfile::load("vlp-16").expect("a product");
        profile.field_deg = Some([0.0, 120.0]);
        let strays = |out_of_step, beam| {
            let mut sensor = Sensor::of(&profile, 0.0, 3);
            assert!(sensor.is_sector());
            sensor.wave(0.05, 30.0, out_of_step);
            let rays = (0..sensor.column_count).map(|column| sensor.ray((beam, column)).1);
            rays.map(|ray| ray.z.asin() - sensor.elevation_rad(beam)).collect::<Vec<f32>>()
        };
        let [first, second, alone] = [(false, 0), (false, 9), (true, 9)].map(|(o, b)| strays(o, b));
        let most = first.iter().map(|stray| stray.abs()).fold(0.0, f32::max);
        assert!((0.049..0.0501).contains(&most), "{most}");
        let apart =
            |other: &[f32]| first.iter().zip(other).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(apart(&second) < 0.01 && apart(&alone) > 0.02);
    }

    #[test]
    fn a_product_waves_and_begins_as_its_profile_says_and_nothing_comes_from_blind_sectors() {
        let mut profile = SensorProfile::load("mid-360").expect("a product");
        profile.pitch_deg = 15.0;
        profile.origin_heights_m = vec![0.1; profile.elevations_deg.len()];
        let (sin, cos) = profile.pitch_deg.to_radians().sin_cos();
        profile.blind = vec![BlindSector { azimuth_deg: [90.0, 60.0], below_deg: 20.0 }];
        let sensor = Sensor::of(&profile, 0.0, 3);
        let shots = 0..sensor.beam_count() * sensor.column_count;
        let shots = shots.map(|i| (i / sensor.column_count, i % sensor.column_count));
        let (mut highest, mut lowest, mut blind) = (0.0f32, 0.0f32, 0);
        for shot in shots {
            let (start, level) = sensor.ray(shot);
            let off = (start - v(sin, 0.0, cos) * 0.1).length();
            assert!(off < 1e-6, "{start:?}");
            // In the frame of the tilted sensor.
            let [x, y, z] = level.to_array();
            let ray = v(x * cos - z * sin, y, x * sin + z * cos);
            let elevation_deg = ray.z.asin().to_degrees();
            highest = highest.max(elevation_deg);
            lowest = lowest.min(elevation_deg);
            let off_deg = ray.x.atan2(ray.y).to_degrees().abs();
            let is_blind = off_deg <= 30.0 && elevation_deg <= 20.0;
            assert_eq!(sensor.is_blind(shot), is_blind, "{ray:?}");
            blind += usize::from(is_blind);
        }
        let [top, bottom] = profile.vertical_field_deg();
        assert!((highest - top).abs() < 0.1 && (lowest - bottom).abs() < 0.1);
        assert!((1000..2000).contains(&blind), "{blind}");
    }
}
