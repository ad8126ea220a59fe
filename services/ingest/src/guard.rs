//! Does the input look like what the model takes, and like the sensor that was given? "No boxes and no error" is the commonest complaint about
//! detectors; its causes are few, and scans show most of them.

use mluc_ipc_types::{Flags, Point};
use mluc_model::{Grid, Manifest, SensorProfile, Takes};

use crate::DecodeReport;
use crate::estimate::{Estimator, SECTORS, SensorEstimate, Unit, Up, direction_rad};

/// Something that does not fit: what was expected, what was found, what to do.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Reason {
    /// NaN and infinities.
    #[error("{:.0} % of the points are not finite, expected at most {:.0} %: check the driver, or let it leave out missing returns", found * 100.0, SHARE_MAX * 100.0)]
    NotFinite {
        /// Share.
        found: f32,
    },
    /// Points without a place.
    #[error("{:.0} % of the points lie at the origin, expected at most {:.0} %: let the driver leave out missing returns", found * 100.0, SHARE_MAX * 100.0)]
    Zeros {
        /// Share.
        found: f32,
    },
    /// Points that are there twice.
    #[error("{:.0} % of the points are copies of others, expected at most {:.0} %: is the same scan merged twice?", found * 100.0, SHARE_MAX * 100.0)]
    Copies {
        /// Share.
        found: f32,
    },
    /// Too few or too many points.
    #[error("{found} points a scan, expected {} to {}: are scans cut into packets, or several put together?", expected[0], expected[1])]
    Points {
        /// Fewest and most.
        expected: [u32; 2],
        /// In a scan.
        found: u32,
    },
    /// Not metres.
    #[error("coordinates seem to be in {}, expected m: multiply them by {}", found.name(), found.in_m())]
    Unit {
        /// Of the coordinates.
        found: Unit,
    },
    /// Not metres either, perhaps.
    #[error("the ground lies {found_m:.1} below the sensor, expected {:.1} to {:.1} m: if the coordinates are in feet, multiply them by 0.3048", expected_m[0], expected_m[1])]
    Feet {
        /// Lowest and highest.
        expected_m: [f32; 2],
        /// As if in m.
        found_m: f32,
    },
    /// z does not point up.
    #[error("{} points up, expected z: turn the points so that x is ahead, y left and z up", found.name())]
    Axes {
        /// Points up.
        found: Up,
    },
    /// The sensor sits elsewhere.
    #[error("sensor {found_m:.2} m above the ground, expected {:.2} to {:.2} m: mount it there, shift z, or take a model for this height", expected_m[0], expected_m[1])]
    Height {
        /// Lowest and highest.
        expected_m: [f32; 2],
        /// Of the scans.
        found_m: f32,
    },
    /// The sensor is not level.
    #[error(
        "sensor tilted by {found_deg:.0} degrees, expected at most {expected_deg:.0}: level it, or turn the points by its extrinsics"
    )]
    Tilt {
        /// Largest.
        expected_deg: f32,
        /// Of the scans.
        found_deg: f32,
    },
    /// Thinner or denser than the model takes.
    #[error("{found} beams, expected {} to {}: take a model for this sensor", expected[0], expected[1])]
    Beams {
        /// Fewest and most.
        expected: [u32; 2],
        /// Of the scans.
        found: u32,
    },
    /// A gap in the field.
    #[error(
        "no returns in {found_deg:.0} degrees of the directions that the model sees: uncover the sensor, or name its field with --sensor"
    )]
    Field {
        /// Width of the gap.
        found_deg: f32,
    },
    /// A driver's range limit.
    #[error(
        "returns end {found_m:.0} m away in nearly all directions, expected {RANGE_END_MIN_M:.0} m or more: raise the driver's range limit"
    )]
    Range {
        /// The end.
        found_m: f32,
    },
    /// Intensities beyond 1.
    #[error("intensities up to {found:.0}, expected 0 to 1: divide them by {}", if *found > 255.5 { 65535 } else { 255 })]
    IntensityScale {
        /// The largest.
        found: f32,
    },
    /// No intensities, and the model reads them.
    #[error(
        "all intensities are 0, expected 0 to 1: let the driver send them, or take a model that does not read them"
    )]
    IntensityMissing,
    /// The same scan again.
    #[error("the same scan came {found} times, expected new ones: check the driver and the source")]
    Frozen {
        /// In a row.
        found: u32,
    },
    /// Not the given sensor: beams.
    #[error(
        "{found} beams up to {off_deg:.1} degrees off those of the given sensor, expected its {expected}: give the right --sensor"
    )]
    SensorBeams {
        /// Of the profile.
        expected: u32,
        /// Of the scans.
        found: u32,
        /// Between beams, on average, or ends of the vertical field.
        off_deg: f32,
    },
    /// Beyond the given sensor's range.
    #[error(
        "returns {found_m:.0} away, expected at most {expected_m:.0} m by the given sensor: if the coordinates are in feet, multiply them by 0.3048"
    )]
    SensorRange {
        /// Of the profile.
        expected_m: f32,
        /// Of the scans.
        found_m: f32,
    },
    /// Not the given sensor's height.
    #[error(
        "sensor {found_m:.2} m above the ground, expected {expected_m:.2} m by the given sensor: correct its height_m"
    )]
    SensorHeight {
        /// Of the profile.
        expected_m: f32,
        /// Of the scans.
        found_m: f32,
    },
}

/// Larger shares of points without a measurement are no few wrong ones; a guess.
const SHARE_MAX: f32 = 0.25;
/// Scans with fewer points are not judged by their shape: a guess.
const POINTS_MIN: u32 = 5_000;
/// A few wrong returns are no other scale.
const INTENSITY_MAX: f32 = 1.001;
/// What an estimate may be off before it counts: height, m, and tilt, degrees.
const HEIGHT_MARGIN_M: f32 = 0.1;
const TILT_MARGIN_DEG: f32 = 1.0;
/// Gaps that are narrower may be something near.
const GAP_MIN_DEG: f32 = 60.0;
/// Seen from so far, a direction is one that the model sees, m.
const GAP_RANGE_M: f32 = 8.0;
/// The range of a real sensor ends farther, m; and a limit is one where this share of directions ends.
const RANGE_END_MIN_M: f32 = 30.0;
const RANGE_END_SHARE: f32 = 0.45;
/// Equal scans in a row that are no chance.
const FROZEN_MIN: u32 = 4;
/// Points of a scan that tell whether it is the last one.
const FROZEN_SAMPLE: usize = 256;
/// The first so many scans are looked at, and then one so often: on average about 1 ms a scan.
const LOOK_FIRST: u64 = 3;
const LOOK_EVERY: u64 = 6;
/// Looks that vote.
const LOOKS: usize = 3;
/// Of the given sensor: beams off by this share of their distance and by so many degrees, fields by so many, counts by this factor, heights by so many m. Guesses.
const BEAM_OFF_SHARE: f32 = 0.3;
const BEAM_OFF_DEG: f32 = 0.25;
const FIELD_OFF_DEG: f32 = 2.0;
const BEAMS_FACTOR: f32 = 1.4;
const HEIGHT_OFF_M: f32 = 0.3;
/// Returns beyond so many times the given sensor's range are no stray ones.
const RANGE_FACTOR: f32 = 2.0;
/// No scan has more reasons.
const REASONS_MAX: usize = 24;

impl Reason {
    /// The frame's flag; [`Flags::INPUT_SUSPECT`] is in it.
    pub fn flag(&self) -> Flags {
        match self {
            Reason::NotFinite { .. }
            | Reason::Zeros { .. }
            | Reason::Copies { .. }
            | Reason::Points { .. } => Flags::SUSPECT_POINTS,
            Reason::Unit { .. } | Reason::Feet { .. } => Flags::SUSPECT_UNIT,
            Reason::Axes { .. } => Flags::SUSPECT_AXES,
            Reason::Height { .. } => Flags::SUSPECT_HEIGHT,
            Reason::Tilt { .. } => Flags::SUSPECT_TILT,
            Reason::Beams { .. } => Flags::SUSPECT_BEAMS,
            Reason::Field { .. } => Flags::SUSPECT_FIELD,
            Reason::Range { .. } => Flags::SUSPECT_RANGE,
            Reason::IntensityScale { .. } | Reason::IntensityMissing => Flags::SUSPECT_INTENSITY,
            Reason::Frozen { .. } => Flags::SUSPECT_FROZEN,
            Reason::SensorBeams { .. }
            | Reason::SensorRange { .. }
            | Reason::SensorHeight { .. } => Flags::SUSPECT_SENSOR,
        }
    }
}

/// What scans are held against.
#[derive(Clone, Debug)]
pub struct Expected {
    takes: Takes,
    grid: Grid,
    uses_intensity: bool,
    sensor: Option<SensorProfile>,
}

impl Expected {
    /// A model, and the sensor that the user has, if given.
    pub fn new(manifest: &Manifest, sensor: Option<SensorProfile>) -> Expected {
        Expected {
            takes: manifest.takes(),
            grid: manifest.network.grid.clone(),
            uses_intensity: manifest.uses_intensity,
            sensor,
        }
    }

    /// Which input the model takes.
    pub fn takes(&self) -> &Takes {
        &self.takes
    }

    /// The sensor that the user has, if given.
    pub fn sensor(&self) -> Option<&SensorProfile> {
        self.sensor.as_ref()
    }

    /// Adds what does not fit to `reasons`.
    pub fn judge(&self, found: &SensorEstimate, reasons: &mut Vec<Reason>) {
        let mut add = |is_so: bool, reason: Reason| {
            if is_so && reasons.len() < REASONS_MAX {
                reasons.push(reason);
            }
        };
        let reason = Reason::NotFinite {
            found: found.not_finite_share,
        };
        add(found.not_finite_share > SHARE_MAX, reason);
        add(
            found.zero_share > SHARE_MAX,
            Reason::Zeros {
                found: found.zero_share,
            },
        );
        let reason = Reason::Copies {
            found: found.duplicate_share,
        };
        add(found.duplicate_share > SHARE_MAX, reason);
        let [low, high] = self.takes.points;
        let reason = Reason::Points {
            expected: [low, high],
            found: found.points,
        };
        add(!(low..=high).contains(&found.points), reason);
        let reason = Reason::IntensityScale {
            found: found.intensity_max,
        };
        add(found.intensity_max > INTENSITY_MAX, reason);
        let is_blind = self.uses_intensity && found.intensity_max == 0.0;
        add(is_blind, Reason::IntensityMissing);
        let measured = (1.0 - found.zero_share) * (1.0 - found.not_finite_share);
        if (found.points as f32 * measured) < POINTS_MIN as f32 {
            return;
        }
        add(
            found.unit != Unit::Metre,
            Reason::Unit { found: found.unit },
        );
        add(found.up != Up::Z, Reason::Axes { found: found.up });
        let is_cut = found.range_end_m < RANGE_END_MIN_M && found.range_end_share > RANGE_END_SHARE;
        add(
            is_cut,
            Reason::Range {
                found_m: found.range_end_m,
            },
        );
        // Scans in another frame or unit say nothing of mounting and beams.
        if found.up == Up::Z {
            self.judge_mounting(found, &mut add);
            self.judge_beams(found, &mut add);
            self.judge_sensor(found, &mut add);
        }
    }

    fn judge_mounting(&self, found: &SensorEstimate, add: &mut impl FnMut(bool, Reason)) {
        let Some(height_m) = found.height_m else {
            return;
        };
        let expected_m @ [low_m, high_m] = self.takes.height_m;
        let fits = |height_m: f32| {
            (low_m - HEIGHT_MARGIN_M..=high_m + HEIGHT_MARGIN_M).contains(&height_m)
        };
        let are_feet = !fits(height_m) && fits(height_m * 0.3048);
        add(
            are_feet,
            Reason::Feet {
                expected_m,
                found_m: height_m,
            },
        );
        let is_elsewhere = !fits(height_m) && !are_feet;
        add(
            is_elsewhere,
            Reason::Height {
                expected_m,
                found_m: height_m,
            },
        );
        let (expected_deg, found_deg) = (self.takes.tilt_max_deg, found.tilt_deg());
        let reason = Reason::Tilt {
            expected_deg,
            found_deg,
        };
        add(found_deg > expected_deg + TILT_MARGIN_DEG, reason);
    }

    fn judge_beams(&self, found: &SensorEstimate, add: &mut impl FnMut(bool, Reason)) {
        let expected @ [low, high] = self.takes.beams;
        let reason = Reason::Beams {
            expected,
            found: found.beams,
        };
        // Without clear beams the count is that of all sensors together.
        let is_known = found.are_beams_clear || found.azimuth_step_deg.is_some();
        let merged = if found.are_beams_clear { 1 } else { 4 };
        let fits = (low..=high.saturating_mul(merged)).contains(&found.beams);
        add(is_known && !fits, reason);
        let field = self.sensor.as_ref().and_then(|sensor| sensor.field_deg);
        let found_deg = if field.is_none() {
            self.gap_deg(found)
        } else {
            0.0
        };
        add(found_deg >= GAP_MIN_DEG, Reason::Field { found_deg });
    }

    /// Degrees of the directions in the model's grid that the field leaves out.
    fn gap_deg(&self, found: &SensorEstimate) -> f32 {
        let [middle_deg, width_deg] = found.field_deg;
        let sectors = (0..SECTORS).map(direction_rad);
        let missing = sectors.filter(|azimuth_rad| {
            let at = [azimuth_rad.cos(), azimuth_rad.sin()].map(|v| v * GAP_RANGE_M);
            let seen = |axis: usize| {
                (self.grid.range_min_m[axis]..self.grid.range_max_m[axis]).contains(&at[axis])
            };
            let off_deg = (azimuth_rad.to_degrees() - middle_deg + 540.0).rem_euclid(360.0) - 180.0;
            seen(0) && seen(1) && off_deg.abs() > width_deg / 2.0
        });
        missing.count() as f32 * 360.0 / SECTORS as f32
    }

    fn judge_sensor(&self, found: &SensorEstimate, add: &mut impl FnMut(bool, Reason)) {
        let Some(sensor) = &self.sensor else {
            return;
        };
        if let (Some(expected_m), Some(found_m)) = (sensor.height_m, found.height_m) {
            let reason = Reason::SensorHeight {
                expected_m,
                found_m,
            };
            add((expected_m - found_m).abs() > HEIGHT_OFF_M, reason);
        }
        let (expected_m, found_m) = (sensor.range_m[1], found.range_longest_m);
        let reason = Reason::SensorRange {
            expected_m,
            found_m,
        };
        add(found_m > RANGE_FACTOR * expected_m, reason);
        let beams = &sensor.elevations_deg;
        let (Some(top), Some(bottom)) = (beams.first(), beams.last()) else {
            return;
        };
        // Of merged sensors the profile's elevations are of one of them.
        if sensor.units.len() > 1 {
            return;
        }
        let spacing_deg = (top - bottom) / (beams.len().max(2) - 1) as f32;
        let off_deg = found.distance_deg(sensor).unwrap_or(0.0);
        let are_off =
            found.are_beams_clear && off_deg > BEAM_OFF_DEG.max(BEAM_OFF_SHARE * spacing_deg);
        // Returns beyond the ends of the field contradict it; beams that see the sky alone have none.
        let [highest, lowest] = found.vertical_field_deg;
        let beyond_deg = (highest - top).max(bottom - lowest);
        let ratio = found.beams as f32 / beams.len() as f32;
        let is_other_count = !(1.0 / BEAMS_FACTOR..=BEAMS_FACTOR).contains(&ratio);
        let reason = Reason::SensorBeams {
            expected: beams.len() as u32,
            found: found.beams,
            off_deg: off_deg.max(beyond_deg),
        };
        add(
            are_off || beyond_deg > FIELD_OFF_DEG || is_other_count,
            reason,
        );
    }
}

/// Looks at the first three scans and then at every sixth. A reason holds until the next look, if two of the last three looks found it, or the first one.
#[derive(Clone, Debug)]
pub struct Guard {
    expected: Expected,
    estimator: Estimator,
    scans: u64,
    /// Of the last looks, the newest last.
    found: [Vec<Reason>; LOOKS],
    reasons: Vec<Reason>,
    last_scan: u64,
    equal_scans: u32,
}

impl Guard {
    /// All memory is made here.
    pub fn new(expected: Expected) -> Guard {
        Guard {
            expected,
            estimator: Estimator::new(),
            scans: 0,
            found: std::array::from_fn(|_| Vec::with_capacity(REASONS_MAX)),
            reasons: Vec::with_capacity(REASONS_MAX + 1),
            last_scan: 0,
            equal_scans: 0,
        }
    }

    /// Whether the next scan is looked at, and is none of the first, whose verdict shall go out with them.
    pub fn looks_later(&self) -> bool {
        self.scans >= LOOK_FIRST && self.scans.is_multiple_of(LOOK_EVERY)
    }

    /// Takes the next scan, its finite points, into account; gives what does not fit.
    pub fn check(&mut self, points: &[Point], report: &DecodeReport) -> &[Reason] {
        if self.scans < LOOK_FIRST || self.scans.is_multiple_of(LOOK_EVERY) {
            self.look(points, report.dropped_not_finite);
        }
        self.count_equal(points);
        self.scans += 1;
        self.reasons
            .retain(|reason| !matches!(reason, Reason::Frozen { .. }));
        if self.equal_scans + 1 >= FROZEN_MIN {
            let found = self.equal_scans + 1;
            self.reasons.push(Reason::Frozen { found });
        }
        &self.reasons
    }

    fn look(&mut self, points: &[Point], not_finite: u32) {
        self.found.rotate_left(1);
        let [before @ .., newest] = &mut self.found;
        newest.clear();
        self.estimator.clear();
        self.estimator.look(points, not_finite);
        self.expected.judge(self.estimator.estimate(), newest);
        let is_first = self.scans == 0;
        self.reasons.clear();
        for (number, reason) in newest.iter().chain(before.iter().flatten()).enumerate() {
            let has_flag = |found: &&Vec<Reason>| found.iter().any(|r| r.flag() == reason.flag());
            let votes = before.iter().filter(has_flag).count() + usize::from(has_flag(&&*newest));
            let is_new =
                number < newest.len() || !self.reasons.iter().any(|r| r.flag() == reason.flag());
            if is_new && (votes >= 2 || is_first) && self.reasons.len() < REASONS_MAX {
                self.reasons.push(*reason);
            }
        }
    }

    /// Counts scans whose points lie where the last one's did; those without points are no scans.
    fn count_equal(&mut self, points: &[Point]) {
        let step = (points.len() / FROZEN_SAMPLE).max(1);
        let mut sum = points.len() as u64;
        for point in points.iter().step_by(step) {
            for value in [point.x_m, point.y_m, point.z_m] {
                sum = (sum ^ u64::from(value.to_bits())).wrapping_mul(0x0000_0100_0000_01b3);
            }
        }
        let is_equal = sum == self.last_scan && !points.is_empty();
        self.equal_scans = if is_equal { self.equal_scans + 1 } else { 0 };
        self.last_scan = sum;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_model::Network;

    fn expected(takes: Takes) -> Expected {
        let network = Network::compact(Grid::kitti_compact(), 3);
        let mut manifest = Manifest::untrained("guard", network);
        manifest.takes = Some(takes);
        Expected::new(&manifest, None)
    }

    const TAKES: Takes = Takes {
        beams: [0, 200],
        height_m: [1.0, 2.0],
        tilt_max_deg: 5.0,
        points: [0, 200_000],
    };

    /// Flat ground so far below the sensor.
    fn ground(height_m: f32, shift: f32) -> Vec<Point> {
        let point = |number: usize| {
            let angle = (number % 900) as f32 * 0.4_f32.to_radians() + shift;
            let range_m = 3.0 + (number / 900) as f32 * 1.5;
            Point {
                x_m: range_m * angle.cos(),
                y_m: range_m * angle.sin(),
                z_m: -height_m,
                intensity: 0.5,
            }
        };
        (0..900 * 40).map(point).collect()
    }

    #[test]
    fn a_fault_that_begins_is_told_within_ten_scans_and_forgotten_when_it_ends() {
        let mut guard = Guard::new(expected(TAKES));
        let report = DecodeReport::default();
        let mut told = Vec::new();
        for scan in 0..40 {
            let height_m = if (9..20).contains(&scan) { 0.5 } else { 1.5 };
            let points = ground(height_m, scan as f32 * 0.001);
            told.push(guard.check(&points, &report).to_vec());
        }
        let has = |scan: usize| !told[scan].is_empty();
        assert!(!has(9) && has(19) && !has(36), "{told:?}");
        let text = told[19][0].to_string();
        let start = "sensor 0.50 m above the ground, expected 1.00 to 2.00 m: ";
        assert!(text.starts_with(start), "{text}");
        assert_eq!(told[19][0].flag(), Flags::SUSPECT_HEIGHT);
    }

    #[test]
    fn the_same_scan_four_times_is_frozen_and_empty_ones_are_not() {
        let mut guard = Guard::new(expected(TAKES));
        let report = DecodeReport::default();
        let frozen = |guard: &mut Guard, points: &[Point]| {
            let reasons = guard.check(points, &report);
            reasons.iter().any(|r| r.flag() == Flags::SUSPECT_FROZEN)
        };
        let scan = ground(1.5, 0.0);
        let told: Vec<bool> = (0..6).map(|_| frozen(&mut guard, &scan)).collect();
        assert_eq!(told, [false, false, false, true, true, true]);
        assert!(!frozen(&mut guard, &ground(1.5, 0.1)));
        assert!((0..6).all(|_| !frozen(&mut guard, &[])));
    }
}
