//! Checks that the input fits the model and the given sensor. "No boxes and no error" is the commonest complaint about
//! detectors; it has few causes, and scans show most of them.

use crate::DecodeReport;
use crate::estimate::{Estimator, SECTORS, SensorEstimate, Unit, Up, direction_rad};
use mluc_ipc_types::{Flags, Point};
use mluc_model::{Grid, Manifest, SensorProfile, Takes, degrees_off};

/// A mismatch. Its text says what was found, what was expected, and what to do.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Reason {
    /// Share of the points that have no measurement of their own; which points these are; the remedy.
    #[error("{:.0} % of the points {}, expected at most {:.0} %: {}", .0 * 100.0, .1, SHARE_MAX * 100.0, .2)]
    Share(f32, &'static str, &'static str),
    /// Points per scan; the fewest and the most expected.
    #[error("{} points a scan, expected {} to {}: are scans cut into packets, or several put together?", .0, .1[0], .1[1])]
    Points(u32, [u32; 2]),
    /// The coordinates are not in metres: their unit.
    #[error("coordinates seem to be in {}, expected m: read them with --scale {}", .0.name(), .0.in_m())]
    Unit(Unit),
    /// Range below which half of the returns lie, m, and the least expected.
    #[error("half of the returns lie within {:.3} m, expected more than {:.1} m: in another unit, or scaled twice? --scale says how long a unit is, in m", .0, .1)]
    Near(f32, f32),
    /// Range beyond which all returns lie, in the scan's unit.
    #[error("all returns lie {:.0} or more away, and none much farther: in map coordinates? --origin X,Y,Z says where the sensor is", .0)]
    Map(f32),
    /// The coordinates may be in feet: depth of the ground below the sensor, read as m; the lowest and the highest expected height of the sensor.
    #[error("the ground lies {:.1} below the sensor, expected {:.1} to {:.1} m: if the coordinates are in feet, read them with --scale 0.3048, else mount it there or take a model for this height", .0, .1[0], .1[1])]
    Feet(f32, [f32; 2]),
    /// Another axis than z points up.
    #[error("{} points up, expected z: say with --axes which axes point ahead, to the left and up{}", .0.name(), if .0.name() == "-z" { " (x,-y,-z for a sensor upside down)" } else { "" })]
    Axes(Up),
    /// Height of the sensor, m; the lowest and the highest expected.
    #[error("sensor {:.2} m above the ground, expected {:.2} to {:.2} m: mount it there, shift z with --origin 0,0,Z (Z is subtracted), or take a model for this height", .0, .1[0], .1[1])]
    Height(f32, [f32; 2]),
    /// Tilt of the sensor, degrees; the largest expected.
    #[error("sensor tilted by {:.0} degrees, expected at most {:.0}: level it, or turn the points by its extrinsics", .0, .1)]
    Tilt(f32, f32),
    /// Beams found; the fewest and the most that the model takes.
    #[error("{} beams, expected {} to {}: take a model for this sensor", .0, .1[0], .1[1])]
    Beams(u32, [u32; 2]),
    /// Width of a gap in the field, degrees.
    #[error("no returns in {:.0} degrees of the directions that the model sees: uncover the sensor, or name its field with --sensor", .0)]
    Field(f32),
    /// Distance at which a driver's range limit ends the returns, and the least distance expected, m.
    #[error("returns end {:.0} m away in nearly half of the directions, expected {:.0} m or more: raise the driver's range limit", .0, .1)]
    Range(f32, f32),
    /// The largest intensity, above 1.
    #[error("intensities up to {}, expected 0 to 1: {}", (.0.min(1e6) * 100.0).ceil() / 100.0, intensity_remedy(*.0))]
    IntensityScale(f32),
    /// All intensities are 0, and the model reads intensities.
    #[error(
        "all intensities are 0, expected 0 to 1: let the driver send them, or take a model that does not read them"
    )]
    IntensityMissing,
    /// How often the same scan came in a row.
    #[error("the same scan came {0} times, expected new ones: check the driver and the source")]
    Frozen(u32),
    /// Not the given sensor's beams: number found; degrees off (mean of the beams, or excess over the vertical field); number in the profile.
    #[error("{} beams, {:.1} degrees off those of the given sensor, expected its {}: give the right --sensor", .0, .1, .2)]
    SensorBeams(u32, f32, u32),
    /// Returns beyond the given sensor's range: their distance and that range, m.
    #[error("returns {:.0} away, expected at most {:.0} m by the given sensor: correct its range_m, or, if the coordinates are in feet, read them with --scale 0.3048", .0, .1)]
    SensorRange(f32, f32),
    /// Not the given sensor's height: found and given, m.
    #[error("sensor {:.2} m above the ground, expected {:.2} m by the given sensor: correct its height_m", .0, .1)]
    SensorHeight(f32, f32),
    /// Not the given sensor's azimuth step: found and given, degrees.
    #[error("columns {:.2} degrees apart, expected {:.2} by the given sensor: correct its azimuth_step_deg", .0, .1)]
    SensorStep(f32, f32),
    /// Returns outside of the given sensor's horizontal field: by up to how many degrees.
    #[error("returns up to {:.0} degrees outside of the horizontal field of the given sensor, expected none: correct its field_deg", .0)]
    SensorField(f32),
}

/// A larger share of points without a measurement is a fault, not a few wrong returns; a guess.
const SHARE_MAX: f32 = 0.25;
/// A scan with fewer measured points is not judged by its shape; a guess.
const POINTS_MIN: u32 = 2_000;
/// Larger intensities are on another scale; the estimate leaves out a few wrong returns.
const INTENSITY_MAX: f32 = 1.001;
/// Margins for the error of an estimate: height, m, and tilt, degrees.
const HEIGHT_MARGIN_M: f32 = 0.1;
const TILT_MARGIN_DEG: f32 = 1.0;
/// A narrower gap may come from something near.
const GAP_MIN_DEG: f32 = 60.0;
/// The model sees a direction if the point at this distance, m, lies in its grid.
const GAP_RANGE_M: f32 = 8.0;
/// A real sensor's range ends beyond this distance, m. A nearer end is a driver's limit if more than the share below of the directions ends there.
const RANGE_END_MIN_M: f32 = 30.0;
const RANGE_END_SHARE: f32 = 0.45;
/// Returns that end within this share of the flattest beam's distance to the ground are cut; a guess.
const OPEN_SHARE: f32 = 0.85;
/// A scan is in another unit if half of its returns lie nearer than this, m, or than the lowest mount.
const NEAR_MAX_M: f32 = 0.5;
/// Scans in a narrow field whose nearest returns lie beyond the first number, and the farthest less than so many times as far, are seen from elsewhere.
const MAP_MIN: f32 = 30.0;
const MAP_FACTOR: f32 = 3.0;
/// How long a place may contradict unit and axes: three minutes at 10 Hz; a guess.
const EXCUSED_LOOKS: u32 = 300;
/// A wall may fill a field this narrow.
const NARROW_DEG: f32 = 100.0;
/// The source is frozen after this number of equal scans in a row.
const FROZEN_MIN: u32 = 4;
/// Sampled points that decide whether a scan equals the one before.
const FROZEN_SAMPLE: usize = 256;
/// Number of first scans that all get a look, and the interval of later looks, in scans. On average a scan costs about 1 ms.
const LOOK_FIRST: u64 = 3;
const LOOK_EVERY: u64 = 6;
/// Number of last looks that vote on a reason.
const LOOKS: usize = 3;
/// Tolerances against the given sensor: beams (share of spacing; degrees), fields (degrees), beam count, column step (factors), height (m). Guesses.
const BEAM_OFF_SHARE: f32 = 0.3;
const BEAM_OFF_DEG: f32 = 0.25;
const FIELD_OFF_DEG: f32 = 2.0;
const AROUND_OFF_DEG: f32 = 10.0;
pub(crate) const BEAMS_FACTOR: f32 = 1.4;
/// The column steps of one product's modes and rates can differ by a factor of two.
const STEP_FACTOR: f32 = 2.2;
const HEIGHT_OFF_M: f32 = 0.3;
/// Returns beyond this multiple of the given sensor's range are not stray ones.
const RANGE_FACTOR: f32 = 2.0;
/// The most reasons per scan.
const REASONS_MAX: usize = 24;

impl Reason {
    /// The flag that this reason sets on the frame; it includes [`Flags::INPUT_SUSPECT`].
    pub fn flag(&self) -> Flags {
        match self {
            Reason::Share(..) | Reason::Points(..) => Flags::SUSPECT_POINTS,
            Reason::Unit(_) | Reason::Near(..) | Reason::Map(_) | Reason::Feet(..) => {
                Flags::SUSPECT_UNIT
            }
            Reason::Axes(_) => Flags::SUSPECT_AXES,
            Reason::Height(..) => Flags::SUSPECT_HEIGHT,
            Reason::Tilt(..) => Flags::SUSPECT_TILT,
            Reason::Beams(..) => Flags::SUSPECT_BEAMS,
            Reason::Field(_) => Flags::SUSPECT_FIELD,
            Reason::Range(..) => Flags::SUSPECT_RANGE,
            Reason::IntensityScale(_) | Reason::IntensityMissing => Flags::SUSPECT_INTENSITY,
            Reason::Frozen(_) => Flags::SUSPECT_FROZEN,
            Reason::SensorBeams(..)
            | Reason::SensorRange(..)
            | Reason::SensorHeight(..)
            | Reason::SensorStep(..)
            | Reason::SensorField(_) => Flags::SUSPECT_SENSOR,
        }
    }
}

/// What scans are compared with: the model's input and the given sensor.
#[derive(Clone, Debug)]
pub struct Expected {
    /// The input that the model takes.
    pub takes: Takes,
    grid: Grid,
    uses_intensity: bool,
    sensor: Option<SensorProfile>,
}

impl Expected {
    /// From a model's manifest and the user's sensor, if given.
    pub fn new(manifest: &Manifest, sensor: Option<SensorProfile>) -> Expected {
        Expected {
            takes: manifest.takes(),
            grid: manifest.network.grid.clone(),
            uses_intensity: manifest.uses_intensity,
            sensor,
        }
    }

    /// The user's sensor, if given.
    pub fn sensor(&self) -> Option<&SensorProfile> {
        self.sensor.as_ref()
    }

    /// Adds a reason to `reasons` for everything that does not fit.
    pub fn judge(&self, found: &SensorEstimate, reasons: &mut Vec<Reason>) {
        let mut add = |is_so: bool, reason: Reason| {
            if is_so && reasons.len() < REASONS_MAX {
                reasons.push(reason);
            }
        };
        let driver = "let the driver leave out missing returns";
        let check = "check the driver, or let it leave out missing returns";
        let twice = "is the same scan merged twice, or does the driver send both returns of a shot? let it send one";
        for (share, what, remedy) in [
            (found.not_finite_share, "are not finite", check),
            (found.zero_share, "lie at the origin", driver),
            (found.duplicate_share, "are copies of others", twice),
            (found.repeat_share, "lie at one place", driver),
        ] {
            add(share > SHARE_MAX, Reason::Share(share, what, remedy));
        }
        let (points, [low, high]) = (found.points, self.takes.points);
        let is_usual = (low..=high).contains(&points);
        add(!is_usual, Reason::Points(points, [low, high]));
        let intensity = found.intensity_max;
        add(intensity > INTENSITY_MAX, Reason::IntensityScale(intensity));
        let measured = (1.0 - found.zero_share) * (1.0 - found.not_finite_share);
        if (points as f32 * measured) < POINTS_MIN as f32 {
            return;
        }
        let is_blind = self.uses_intensity && intensity == 0.0;
        add(is_blind, Reason::IntensityMissing);
        let nearest = found.range_nearest_m / found.unit.in_m();
        let is_far = nearest > MAP_MIN && found.field_deg[1] < NARROW_DEG;
        let sees_all = self.sensor.as_ref().is_none_or(|s| s.field_deg.is_none());
        let is_alike = found.range_longest_m < MAP_FACTOR * found.range_nearest_m;
        if is_far && is_alike && sees_all {
            add(true, Reason::Map(nearest));
            return;
        }
        add(found.unit != Unit::default(), Reason::Unit(found.unit));
        let (median_m, least_m) = (found.range_median_m, self.takes.height_m[0].min(NEAR_MAX_M));
        add(median_m < least_m, Reason::Near(median_m, least_m));
        add(found.up != Up::default(), Reason::Axes(found.up));
        let (end_m, end_share) = (found.range_end_m, found.range_end_share);
        let sees_m = self.sensor.as_ref().map_or(f32::MAX, |s| s.range_m[1]);
        let least_m = RANGE_END_MIN_M.min(sees_m - 1.0);
        // A wall in front of a narrow field ends all of its beams.
        let is_wide = found.field_deg[1] > NARROW_DEG;
        // On open ground all returns end where the flattest beam meets it.
        let slopes = found.elevations_deg.iter().map(|deg| -deg.to_radians().tan());
        let flattest = slopes.filter(|slope| *slope > 0.0).reduce(f32::min);
        let open_m = (found.height_m.zip(flattest)).map_or(f32::MAX, |(m, slope)| m / slope);
        let ends_m = least_m.min(OPEN_SHARE * open_m);
        let is_cut = is_wide && end_m < ends_m && end_share > RANGE_END_SHARE;
        add(is_cut, Reason::Range(end_m, least_m));
        // Where another axis points up, the estimate says nothing about mounting and beams.
        if found.up == Up::default() {
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
        let own_m = self.sensor.as_ref().and_then(|sensor| sensor.height_m);
        let is_given = own_m.is_some_and(|own_m| (own_m - height_m).abs() <= HEIGHT_OFF_M);
        let are_feet = fits(height_m * 0.3048) && !is_given;
        let [feet, elsewhere] = [Reason::Feet, Reason::Height].map(|of| of(height_m, expected_m));
        add(!fits(height_m), if are_feet { feet } else { elsewhere });
        let (tilt_deg, most_deg) = (found.tilt_deg(), self.takes.tilt_max_deg);
        let is_tilted = tilt_deg > most_deg + TILT_MARGIN_DEG;
        add(is_tilted, Reason::Tilt(tilt_deg, most_deg));
    }

    fn judge_beams(&self, found: &SensorEstimate, add: &mut impl FnMut(bool, Reason)) {
        let [low, high] = self.takes.beams;
        // Without clear beams, the count covers all merged sensors.
        let has_waves = self.sensor.as_ref().is_some_and(|s| s.wave.is_some());
        let is_known = found.are_beams_clear || found.azimuth_step_deg.is_some();
        let merged = if found.are_beams_clear { 1 } else { 4 };
        let fits = (low..=high.saturating_mul(merged)).contains(&found.beams);
        // Lines that wave show no separate beams.
        let are_others = is_known && !fits && !has_waves;
        add(are_others, Reason::Beams(found.beams, [low, high]));
        let gap_deg = self.gap_deg(found);
        add(gap_deg >= GAP_MIN_DEG, Reason::Field(gap_deg));
    }

    /// Degrees of the directions that are in the model's grid and the given sensor's field, outside of the found field, and not hidden by the robot.
    fn gap_deg(&self, found: &SensorEstimate) -> f32 {
        let [middle_deg, width_deg] = found.field_deg;
        // Merged units with a field each look in their own direction: no gap is judged.
        let is_swept = |azimuth_deg: f32| match self.sensor.as_ref() {
            Some(SensorProfile { field_deg: Some([middle_deg, width_deg]), units, .. }) => {
                units.is_empty() && degrees_off(azimuth_deg, *middle_deg) <= width_deg / 2.0
            }
            _ => true,
        };
        let sectors = (0..SECTORS).map(direction_rad);
        let missing = sectors.filter(|azimuth_rad| {
            let at = [azimuth_rad.cos(), azimuth_rad.sin()].map(|v| v * GAP_RANGE_M);
            let seen = |axis: usize| {
                (self.grid.range_min_m[axis]..self.grid.range_max_m[axis]).contains(&at[axis])
            };
            let azimuth_deg = azimuth_rad.to_degrees();
            let is_hidden = self.sensor.as_ref().is_some_and(|s| s.hides(azimuth_deg));
            let is_outside = degrees_off(azimuth_deg, middle_deg) > width_deg / 2.0;
            seen(0) && seen(1) && is_swept(azimuth_deg) && is_outside && !is_hidden
        });
        missing.count() as f32 * 360.0 / SECTORS as f32
    }

    fn judge_sensor(&self, found: &SensorEstimate, add: &mut impl FnMut(bool, Reason)) {
        let Some(sensor) = &self.sensor else {
            return;
        };
        if let (Some(own_m), Some(found_m)) = (sensor.height_m, found.height_m) {
            let is_off = (own_m - found_m).abs() > HEIGHT_OFF_M;
            add(is_off, Reason::SensorHeight(found_m, own_m));
        }
        let (longest_m, own_m) = (found.range_longest_m, sensor.range_m[1]);
        let is_beyond = longest_m > RANGE_FACTOR * own_m;
        add(is_beyond, Reason::SensorRange(longest_m, own_m));
        // Merged units each look in their own direction: their field is not judged.
        let field_deg = sensor.field_deg.filter(|_| sensor.units.is_empty());
        if let Some([middle_deg, width_deg]) = field_deg {
            let [found_deg, found_width_deg] = found.field_deg;
            // Around the whole turn, the middle means nothing.
            let is_turn = found_width_deg >= 360.0;
            let turn_deg = degrees_off(if is_turn { middle_deg } else { found_deg }, middle_deg);
            let outside_deg = turn_deg + (found_width_deg - width_deg) / 2.0;
            // If the two gaps do not overlap, the found one is a cover, and returns on the far side of the profile's own gap are in its field.
            let is_gap_shared = 2.0 * turn_deg < 720.0 - width_deg - found_width_deg;
            let is_outside = outside_deg > AROUND_OFF_DEG && is_gap_shared;
            add(is_outside, Reason::SensorField(outside_deg));
        }
        let beams = &sensor.elevations_deg;
        let [top, bottom] = sensor.vertical_field_deg();
        // For merged sensors, the profile has the elevations of one sensor only. Levelled points also have other elevations.
        let levelled_deg = sensor.pitch_deg.hypot(sensor.roll_deg) - found.tilt_deg();
        let is_levelled = found.height_m.is_some() && levelled_deg > FIELD_OFF_DEG;
        if !sensor.units.is_empty() || is_levelled {
            return;
        }
        if let Some(step_deg) = found.azimuth_step_deg {
            let own_deg = sensor.azimuth_step_deg;
            let is_near = (1.0 / STEP_FACTOR..=STEP_FACTOR).contains(&(step_deg / own_deg));
            let is_other = found.are_beams_clear && !is_near;
            add(is_other, Reason::SensorStep(step_deg, own_deg));
        }
        let spacing_deg = (top - bottom) / (beams.len().max(2) - 1) as f32;
        let off_deg = found.distance_deg(sensor).unwrap_or(0.0);
        let are_off =
            found.are_beams_clear && off_deg > BEAM_OFF_DEG.max(BEAM_OFF_SHARE * spacing_deg);
        // Returns beyond the ends of the vertical field contradict it; missing returns do not, since some beams see only the sky.
        let [highest, lowest] = found.vertical_field_deg;
        let beyond_deg = (highest - top).max(bottom - lowest);
        // Nor do beams that the robot itself hides all around.
        let is_hidden =
            |deg: f32| sensor.blind.iter().any(|b| b.azimuth_deg[1] >= 360.0 && deg <= b.below_deg);
        let is_seen = |deg: &&f32| **deg < highest + 0.5 && !is_hidden(**deg);
        let seen = beams.iter().filter(is_seen).count();
        let ratio = found.beams as f32 / seen.max(1) as f32;
        // Lines that wave show no separate beams.
        let is_other_count =
            sensor.wave.is_none() && !(1.0 / BEAMS_FACTOR..=BEAMS_FACTOR).contains(&ratio);
        let is_other = are_off || beyond_deg > FIELD_OFF_DEG || is_other_count;
        let off_deg = off_deg.max(beyond_deg);
        let reason = Reason::SensorBeams(found.beams, off_deg, beams.len() as u32);
        add(is_other, reason);
    }
}

/// Looks at the first three scans, then at every sixth. A reason holds until the next look if two of the last three looks found it, or the first one.
#[derive(Clone, Debug)]
pub struct Guard {
    expected: Expected,
    estimator: Estimator,
    scans: u64,
    /// Reasons that the last looks found, the newest last.
    found: [Vec<Reason>; LOOKS],
    reasons: Vec<Reason>,
    last_scan: u64,
    equal_scans: u32,
    /// Looks left in which a doubt about unit or axes is the place (a bridge, a lift): these do not change, and a scan without a fault came before.
    excused: u32,
}

impl Guard {
    /// Allocates all memory.
    pub fn new(expected: Expected) -> Guard {
        Guard {
            expected,
            estimator: Estimator::new(),
            scans: 0,
            found: std::array::from_fn(|_| Vec::with_capacity(REASONS_MAX)),
            reasons: Vec::with_capacity(REASONS_MAX + 1),
            last_scan: 0,
            equal_scans: 0,
            excused: 0,
        }
    }

    /// Whether the next scan gets a look that can wait until the frame is sent. The verdicts on the first scans go out with their frames.
    pub fn looks_later(&self) -> bool {
        self.scans >= LOOK_FIRST && self.scans.is_multiple_of(LOOK_EVERY)
    }

    /// Checks the next scan, given its finite points, and returns what does not fit.
    pub fn check(&mut self, points: &[Point], report: &DecodeReport) -> &[Reason] {
        if self.scans < LOOK_FIRST || self.scans.is_multiple_of(LOOK_EVERY) {
            self.look(points, report.dropped_not_finite);
        }
        self.count_equal(points);
        self.scans += 1;
        self.reasons.retain(|r| !matches!(r, Reason::Frozen(_)));
        if self.equal_scans + 1 >= FROZEN_MIN {
            self.reasons.push(Reason::Frozen(self.equal_scans + 1));
        }
        &self.reasons
    }

    fn look(&mut self, points: &[Point], not_finite: u32) {
        self.found.rotate_left(1);
        let [before @ .., newest] = &mut self.found;
        newest.clear();
        self.estimator.clear();
        self.estimator.look(points, not_finite);
        let found = self.estimator.estimate();
        self.expected.judge(found, newest);
        let is_sound = found.height_m.is_some() && newest.is_empty();
        let left = if is_sound { EXCUSED_LOOKS } else { self.excused };
        self.excused = left.saturating_sub(1);
        for reason in newest.iter_mut().filter(|_| left > 0) {
            *reason = match *reason {
                Reason::Feet(found_m, takes_m) => Reason::Height(found_m, takes_m),
                Reason::Axes(_) => Reason::Tilt(90.0, self.expected.takes.tilt_max_deg),
                other => other,
            };
        }
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

    /// Counts scans in a row whose sampled points lie at the same places. Empty scans do not count.
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

/// What to do about a largest intensity. One that fits no usual scale is rather another quantity.
fn intensity_remedy(most: f32) -> &'static str {
    match most {
        90.0..=255.5 => "read them with --intensity-scale 0.00392",
        255.5..=65_535.5 => "read them with --intensity-scale 0.0000153",
        _ => {
            "is the fourth number the intensity? --columns names the columns, --intensity-scale scales it"
        }
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

    const TAKES: Takes =
        Takes { beams: [0, 200], height_m: [1.0, 2.0], tilt_max_deg: 5.0, points: [0, 200_000] };

    /// Flat ground at this depth below the sensor.
    fn ground(height_m: f32, shift: f32) -> Vec<Point> {
        let point = |number: usize| {
            let angle = (number % 900) as f32 * 0.4_f32.to_radians() + shift;
            let range_m = 3.0 + (number / 900) as f32 * 1.5;
            let (sin, cos) = angle.sin_cos();
            bytemuck::cast::<[f32; 4], Point>([range_m * cos, range_m * sin, -height_m, 0.5])
        };
        (0..900 * 40).map(point).collect()
    }

    /// What a VLP-16 sees of a wide floor, and of a ceiling at this height above it.
    fn floor(height_m: f32, ceiling_m: f32) -> Vec<Point> {
        let point = |number: u16| {
            let (sin, cos) = (f32::from(number / 16) * 0.4).to_radians().sin_cos();
            let slope = (f32::from(number % 16) * 2.0 - 15.0).to_radians().tan();
            let z_m = if slope < 0.0 { -height_m } else { ceiling_m - height_m };
            let at_m = z_m / slope;
            let point = [at_m * cos, at_m * sin, z_m, 0.5];
            (at_m < 90.0).then(|| bytemuck::cast::<[f32; 4], Point>(point))
        };
        (0..16 * 900).filter_map(point).collect()
    }

    #[test]
    fn open_ground_and_low_ceilings_are_no_faults() {
        let mut sensor = SensorProfile::load("vlp-16").expect("a product");
        let takes = Takes { height_m: [0.3, 3.0], ..TAKES };
        for (height_m, ceiling_m) in [(1.7, f32::MAX), (0.4, f32::MAX), (0.5, 2.5), (0.8, 2.8)] {
            sensor.height_m = Some(height_m);
            let mut expected = expected(takes.clone());
            expected.sensor = Some(sensor.clone());
            let mut guard = Guard::new(expected);
            let found = guard.check(&floor(height_m, ceiling_m), &DecodeReport::default());
            assert_eq!(found, [], "{height_m} {ceiling_m}");
        }
    }

    #[test]
    fn a_tilt_beyond_the_limit_and_its_margin_is_told() {
        let is_told = |pitch_deg| {
            let found = SensorEstimate {
                points: 20_000,
                height_m: Some(1.5),
                pitch_deg,
                ..SensorEstimate::default()
            };
            let mut reasons = vec![];
            expected(TAKES).judge(&found, &mut reasons);
            reasons.iter().any(|r| r.flag() == Flags::SUSPECT_TILT)
        };
        assert_eq!([5.9, -5.9, 6.1, -6.1].map(is_told), [false, false, true, true]);
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
    fn columns_and_a_field_that_are_not_the_given_sensors_are_told() {
        let mut sensor = SensorProfile::load("vlp-16").expect("a product");
        sensor.field_deg = Some([0.0, 120.0]);
        let mut expected = expected(TAKES);
        let found = |step_deg: f32, middle_deg: f32| SensorEstimate {
            points: 20_000,
            beams: 16,
            are_beams_clear: true,
            elevations_deg: sensor.elevations_deg.clone(),
            vertical_field_deg: sensor.vertical_field_deg(),
            azimuth_step_deg: Some(step_deg),
            field_deg: [middle_deg, 118.0],
            ..SensorEstimate::default()
        };
        expected.sensor = Some(sensor.clone());
        expected.takes.beams = [38, 103];
        let step_deg = sensor.azimuth_step_deg;
        let told = |found: &SensorEstimate, flag: Flags| {
            let mut reasons = vec![];
            expected.judge(found, &mut reasons);
            reasons.retain(|reason| reason.flag() == flag);
            reasons
        };
        let (sensor, field) = (Flags::SUSPECT_SENSOR, Flags::SUSPECT_FIELD);
        let mut half = found(2.0 * step_deg, 5.0);
        assert_eq!((told(&half, sensor), told(&half, field)), (vec![], vec![]));
        half.field_deg[1] = 40.0;
        let gap = told(&half, field);
        assert!(matches!(gap[..], [Reason::Field(75.0..85.0)]), "{gap:?}");
        let wide = found(3.0 * step_deg, 0.0);
        let step = Reason::SensorStep(3.0 * step_deg, step_deg);
        assert_eq!(told(&wide, sensor), [step]);
        let aside = found(step_deg, -170.0);
        assert_eq!(told(&aside, sensor), [Reason::SensorField(169.0)]);
        let beams = Reason::Beams(16, [38, 103]);
        assert_eq!(told(&aside, Flags::SUSPECT_BEAMS), [beams]);
        let blind = [Reason::IntensityMissing];
        assert_eq!(told(&aside, Flags::SUSPECT_INTENSITY), blind);
    }

    #[test]
    fn scans_from_elsewhere_in_another_unit_or_with_returns_at_one_place_are_told() {
        type Change = fn(usize, [f32; 3]) -> [f32; 3];
        let cases: [(Change, &str); 5] = [
            (|_, [x, y, z]| [x + 200.0, y + 90.0, z], "map coordinates"),
            (|_, at| at.map(|v| v * 0.01), "scaled twice"),
            (|i, at| [at, [5.0; 3]][i % 2], "lie at one place"),
            (|i, at| [at, [3e38; 3]][usize::from(i % 200 == 0)], ""),
            (|_, at| at, ""),
        ];
        for (change, words) in cases {
            let mut scan = ground(1.5, 0.0);
            for (i, p) in scan.iter_mut().enumerate() {
                [p.x_m, p.y_m, p.z_m] = change(i, [p.x_m, p.y_m, p.z_m]);
            }
            let mut guard = Guard::new(expected(TAKES));
            let reasons = guard.check(&scan, &DecodeReport::default());
            let found = reasons.iter().map(Reason::to_string).collect::<String>();
            let fits = found.contains(words) && found.is_empty() == words.is_empty();
            assert!(fits, "{words}: {found}");
        }
    }

    #[test]
    fn a_bridge_is_no_other_unit() {
        let (street, below) = (ground(1.5, 0.0), ground(5.0, 0.0));
        let (height, unit) = (Flags::SUSPECT_HEIGHT, Flags::SUSPECT_UNIT);
        for (scans_before, looks, expected_flag) in [(0, 2, unit), (1, 2, height), (1, 310, unit)] {
            let mut guard = Guard::new(expected(TAKES));
            let scans = std::iter::repeat_n(&street, scans_before);
            scans.chain(std::iter::repeat_n(&below, looks)).for_each(|scan| guard.look(scan, 0));
            let flags = guard.reasons.iter().map(Reason::flag);
            assert_eq!(flags.collect::<Vec<_>>(), [expected_flag], "{looks}");
        }
    }

    #[test]
    fn the_same_scan_four_times_is_frozen_and_empty_ones_are_not() {
        let mut guard = Guard::new(expected(TAKES));
        let report = DecodeReport::default();
        let frozen = |guard: &mut Guard, points: &[Point]| {
            guard.check(points, &report).iter().any(|r| r.flag() == Flags::SUSPECT_FROZEN)
        };
        let scan = ground(1.5, 0.0);
        let told: Vec<bool> = (0..6).map(|_| frozen(&mut guard, &scan)).collect();
        assert_eq!(told, [false, false, false, true, true, true]);
        assert!(!frozen(&mut guard, &ground(1.5, 0.1)));
        assert!((0..6).all(|_| !frozen(&mut guard, &[])));
    }
}
