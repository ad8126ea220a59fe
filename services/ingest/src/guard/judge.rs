//! Compares the estimate of a scan with the model's input and the given sensor.

use super::{REASONS_MAX, Reason, reason::SHARE_MAX};
use crate::estimate::{BEAMS_FACTOR, SECTORS, SensorEstimate, Unit, Up, direction_rad};
use mluc_model::{Grid, Manifest, SensorProfile, Takes, degrees_off};

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
const LEVEL_FACTOR: f32 = 1.5;
/// A wall may fill a field this narrow.
const NARROW_DEG: f32 = 100.0;
/// Tolerances against the given sensor: beams (share of spacing; degrees), fields (degrees), column step (factor), height (m). Guesses.
const BEAM_OFF_SHARE: f32 = 0.3;
const BEAM_OFF_DEG: f32 = 0.25;
const FIELD_OFF_DEG: f32 = 2.0;
const AROUND_OFF_DEG: f32 = 10.0;
/// The column steps of one product's modes and rates can differ by a factor of two.
const STEP_FACTOR: f32 = 2.2;
const HEIGHT_OFF_M: f32 = 0.3;
/// Returns beyond this multiple of the given sensor's range are not stray ones.
const RANGE_FACTOR: f32 = 2.0;

/// What scans are compared with: the model's input and the given sensor.
#[derive(Clone, Debug)]
pub struct Expected {
    /// The input that the model takes.
    pub takes: Takes,
    grid: Grid,
    uses_intensity: bool,
    pub(super) sensor: Option<SensorProfile>,
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
        // All returns above or below the sensor: heights above the sea, for instance.
        let [top_deg, bottom_deg] = found.vertical_field_deg;
        let is_one_sided = bottom_deg > 0.0 || top_deg < 0.0;
        // Far off, the estimate takes them for another unit; but real scans in one spread over more than half of their range.
        let is_level = found.range_longest_m < LEVEL_FACTOR * found.range_nearest_m;
        let is_far_off = nearest > MAP_MIN && (found.range_nearest_m > MAP_MIN || is_level);
        let is_off_height = is_one_sided && is_far_off;
        if is_far && is_alike && sees_all || is_off_height {
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
