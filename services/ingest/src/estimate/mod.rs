//! Estimates what a sensor is and how it is mounted, from its scans: for `mluc doctor --input`, `mluc-lab sensor`, and the [`crate::Guard`].
//!
//! An [`Estimator`] looks at scans and keeps sums and histograms; it allocates their memory once. It cannot detect that y is mirrored or that the scan
//! is turned about z: a scan in an unknown place looks the same.

mod content;
mod directions;
pub mod elevations;
mod level;
mod profile;
mod step;
mod view;

use content::Content;
use directions::{Directions, NEAR_M, SECTOR_DEG};
pub use directions::{SECTORS, direction_rad};
use elevations::Elevations;
use level::{Level, LevelFinder};
use mluc_geometry::quantile;
use mluc_ipc_types::Point;
use mluc_model::BlindSector;
pub(crate) use profile::BEAMS_FACTOR;
pub use profile::Nearest;
use serde::Serialize;
use step::StepVotes;
pub use view::View;

/// Sums that need no full count take one point in this many; it is no multiple of a number of beams.
const SAMPLE: usize = 7;

/// Whether a return is one of the sample: one in [`SAMPLE`] on average, but not every seventh, because all columns may have seven.
fn is_sampled(number: usize) -> bool {
    (number as u32).wrapping_mul(0x9e37_79b9) < u32::MAX / SAMPLE as u32
}
/// The most beams in an estimate.
const BEAMS_MAX: usize = 256;
/// A spinning sensor has at least this many beams.
const BEAMS_MIN: f32 = 4.0;
/// Peaks are beams if their number is at least this share of the returns per column; else they are smeared.
const CLEAR_SHARE: f32 = 0.72;
/// Peaks of all scans together are beams if their number is at least this share of the number in single scans.
const STAYING_SHARE: f32 = 0.85;
/// The most scans whose peaks and ground are kept; further scans only add to sums.
const SCANS_MAX: usize = 64;
/// A plane is the ground if at least this share of the tiles lies on it.
const GROUND_SHARE_MIN: f32 = 0.18;
/// A return this near the plane is on the ground, m.
const ON_GROUND_M: f32 = 0.25;
/// Below this share, the ground is searched along the other axes too. There it needs the share below, and the factor below times the share along z.
const LEVEL_SHARE_POOR: f32 = 0.35;
const OTHER_AXIS_SHARE_MIN: f32 = 0.25;
const OTHER_AXIS_GAIN: f32 = 1.5;
/// Heights at which sensors are mounted, m; used only to find the axis that points up and a lost ground.
const HEIGHT_M: std::ops::Range<f32> = 0.15..5.0;

/// The unit in which the coordinates came: m, cm or mm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Unit(usize);

impl Unit {
    /// Length of the unit in m.
    pub fn in_m(self) -> f32 {
        [1.0, 0.01, 0.001][self.0]
    }

    /// Name of the unit: `m`, `cm` or `mm`.
    pub fn name(self) -> &'static str {
        ["m", "cm", "mm"][self.0]
    }
}

/// The axis that points up: z (as expected), x or y, each followed by its opposite.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Up(usize);

impl Up {
    /// Name of the axis: `z`, `-z` and so on.
    pub fn name(self) -> &'static str {
        ["z", "-z", "x", "-x", "y", "-y"][self.0]
    }
}

/// What some scans show of their sensor. Lengths are in m, whatever unit the scans came in.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SensorEstimate {
    /// Scans that were looked at.
    pub scans: u32,
    /// Points per scan, finite or not.
    pub points: u32,
    /// Share of points that are not finite.
    pub not_finite_share: f32,
    /// Share of points at the origin.
    pub zero_share: f32,
    /// Share of points that are copies of other points.
    pub duplicate_share: f32,
    /// Share of points at the commonest place other than the origin.
    pub repeat_share: f32,
    /// Unit of the coordinates.
    pub unit: Unit,
    /// The axis that points up.
    pub up: Up,
    /// Number of beams; where they are not clear, the returns per column.
    pub beams: u32,
    /// Whether elevations have a peak for every beam: not so where several sensors are merged, or beams begin at different points.
    pub are_beams_clear: bool,
    /// Elevations that have a peak, degrees, from the top down.
    pub elevations_deg: Vec<f32>,
    /// Azimuth between neighbouring columns, degrees.
    pub azimuth_step_deg: Option<f32>,
    /// Elevations of the uppermost and the lowest returns, degrees.
    pub vertical_field_deg: [f32; 2],
    /// Middle and width of the horizontal field, degrees, counter-clockwise from ahead.
    pub field_deg: [f32; 2],
    /// Range below which 10 % of the returns lie, m.
    pub range_nearest_m: f32,
    /// Range below which half of the returns lie, m.
    pub range_median_m: f32,
    /// Range below which 99.9 % of the returns lie, m.
    pub range_longest_m: f32,
    /// Where the range ends, m: the 95th percentile of the farthest returns in all directions.
    pub range_end_m: f32,
    /// Share of the directions that end about there; see [`SensorEstimate::range_end_m`].
    pub range_end_share: f32,
    /// The largest intensity.
    pub intensity_max: f32,
    /// Height of the sensor above the ground, m; `None`: no ground found.
    pub height_m: Option<f32>,
    /// Pitch, degrees; positive looks down.
    pub pitch_deg: f32,
    /// Roll, degrees; positive sinks to the right.
    pub roll_deg: f32,
    /// Degrees of the directions in which something near stays over all scans: the robot itself.
    pub own_body_deg: f32,
}

impl SensorEstimate {
    /// Angle between the sensor's axis and the normal of the ground, degrees.
    pub fn tilt_deg(&self) -> f32 {
        self.pitch_deg.hypot(self.roll_deg)
    }

    /// Median distance of neighbouring beams, degrees; `None` where they are not clear.
    pub fn spacing_deg(&self) -> Option<f32> {
        let gaps_deg = self.elevations_deg.windows(2).map(|pair| f64::from(pair[0] - pair[1]));
        let middle = median(&mut gaps_deg.collect::<Vec<_>>())?;
        self.are_beams_clear.then_some(middle)
    }
}

/// Turns a point from the scan's axes to axes with another one up.
type Turn = fn([f32; 3]) -> [f32; 3];

/// Estimates a sensor from scans.
#[derive(Clone, Debug)]
pub struct Estimator {
    content: Content,
    /// Elevations of all scans.
    pub elevations: Elevations,
    directions: Directions,
    steps: StepVotes,
    finder: LevelFinder,
    /// Height (m), pitch and roll (degrees) of each scan that has a ground.
    grounds: [Vec<f64>; 3],
    /// Number of elevation peaks of each scan.
    peaks: Vec<f64>,
    /// Number of scans for each axis that points up.
    ups: [u32; 6],
    /// Elevations of the current scan.
    scan_elevations: Elevations,
    scan_beams_deg: Vec<f32>,
    estimate: SensorEstimate,
}

impl Estimator {
    /// Allocates all memory.
    #[allow(clippy::new_without_default)]
    pub fn new() -> Estimator {
        let mut content = Content::default();
        content.clear();
        Estimator {
            content,
            elevations: Elevations::default(),
            directions: Directions::default(),
            steps: StepVotes::default(),
            finder: LevelFinder::default(),
            grounds: std::array::from_fn(|_| Vec::with_capacity(SCANS_MAX)),
            peaks: Vec::with_capacity(SCANS_MAX),
            ups: [0; 6],
            scan_elevations: Elevations::default(),
            scan_beams_deg: Vec::with_capacity(BEAMS_MAX),
            estimate: SensorEstimate {
                elevations_deg: Vec::with_capacity(BEAMS_MAX),
                ..SensorEstimate::default()
            },
        }
    }

    /// Forgets all scans.
    pub fn clear(&mut self) {
        self.content.clear();
        self.elevations.clear();
        self.directions = Directions::default();
        self.steps.clear();
        self.grounds.iter_mut().for_each(Vec::clear);
        self.peaks.clear();
        self.ups = [0; 6];
        self.estimate.scans = 0;
    }

    /// Directions that the robot's own body hides, for a profile.
    pub fn blind(&self) -> Vec<BlindSector> {
        self.directions.blind()
    }

    /// Looks at a scan: its finite points, and the number of points that were not finite. About 5 ms for 120,000 points.
    pub fn look(&mut self, points: &[Point], not_finite: u32) {
        self.content.add_scan(points, not_finite, SAMPLE);
        let scale = self.content.unit.in_m();
        let at = |p: &Point| [p.x_m * scale, p.y_m * scale, p.z_m * scale];
        let (up, ground) = self.find_ground(points.iter().map(at));
        let level = ground.filter(|_| up == Up::default());
        self.ups[up.0] += 1;
        self.scan_elevations.clear();
        for (number, point) in points.iter().enumerate() {
            let [x, y, z] = at(point);
            let distance = (x * x + y * y).sqrt();
            let range_m = (distance * distance + z * z).sqrt();
            // Near returns may come from the robot, except those on the ground.
            let is_near = range_m < NEAR_M;
            let above_m = || level.map_or(z, |l| l.plane.above_m([x, y, z]) as f32);
            let on_m = if is_near { above_m() } else { 0.0 };
            let is_ground = level.is_some() && range_m > 0.0 && on_m.abs() < ON_GROUND_M;
            if !is_near || is_ground {
                self.scan_elevations.add(z, distance);
            }
            if is_sampled(number) && range_m > 0.0 {
                self.directions.add([x, y, z], range_m, on_m < ON_GROUND_M);
            }
        }
        self.directions.end_scan();
        self.elevations.add_all(&self.scan_elevations);
        self.scan_elevations.find(&mut self.scan_beams_deg);
        if self.peaks.len() < SCANS_MAX {
            self.peaks.push(self.scan_beams_deg.len() as f64);
            let own = level.iter().flat_map(mounting).map(f64::from);
            self.grounds.iter_mut().zip(own).for_each(|(all, own)| all.push(own));
        }
        self.look_along_beams(points, scale, level.map_or(NEAR_M, |l| l.z_m().abs()));
        self.estimate.scans += 1;
    }

    /// The axis that points up, and the plane of the ground in axes turned that way.
    fn find_ground(&mut self, scan: impl Iterator<Item = [f32; 3]> + Clone) -> (Up, Option<Level>) {
        let along_z = self.finder.below(scan.clone());
        let share = along_z.map_or(0.0, |level| level.share);
        let mut best = (Up::default(), along_z);
        if share < LEVEL_SHARE_POOR {
            let others: [(Up, Turn); 3] = [
                (Up(1), |[x, y, z]| [x, -y, -z]),
                (Up(2), |[x, y, z]| [y, z, x]),
                (Up(4), |[x, y, z]| [z, x, y]),
            ];
            let mut least = (OTHER_AXIS_GAIN * share).max(OTHER_AXIS_SHARE_MIN);
            for (up, turned) in others {
                if let Some(level) = self.finder.find(scan.clone().map(turned))
                    && level.share > least
                    && HEIGHT_M.contains(&level.z_m().abs())
                {
                    (least, best) = (level.share, (up, Some(level)));
                }
            }
        }
        let (up, level) = best;
        let level = level.filter(|level| level.share >= GROUND_SHARE_MIN);
        let is_above = level.is_some_and(|level| level.z_m() > HEIGHT_M.start);
        // A ground above the sensor means that the opposite axis points up.
        (Up(up.0 ^ usize::from(is_above)), level)
    }

    /// Votes for the step between columns, along a few beams that are apart from others and meet the ground far enough from the sensor.
    fn look_along_beams(&mut self, points: &[Point], scale: f32, height_m: f32) {
        let lowest_deg = -(height_m / NEAR_M).min(1.0).asin().to_degrees();
        let far = self.scan_beams_deg.partition_point(|deg| *deg > lowest_deg);
        let beams = &self.scan_beams_deg[..far];
        let count = beams.len();
        for number in 1..3 {
            let Some(&beam_deg) = beams.get(count * number / 3) else {
                continue;
            };
            let half_deg = (beams.windows(2).map(|p| p[0] - p[1])).fold(0.3, f32::min) / 3.0;
            let [low, high] = [-half_deg, half_deg].map(|d| (beam_deg + d).to_radians().tan());
            for point in points {
                let [x, y, z] = [point.x_m, point.y_m, point.z_m].map(|v| v * scale);
                let distance = (x * x + y * y).sqrt();
                if z >= low * distance && z <= high * distance && distance > NEAR_M {
                    self.steps.add(x, y);
                }
            }
            self.steps.end_beam();
        }
    }

    /// The estimate from the scans since [`Estimator::clear`].
    pub fn estimate(&mut self) -> &SensorEstimate {
        let estimate = &mut self.estimate;
        // Of equal counts the first axis wins: z before the others.
        let most = (0..self.ups.len()).rev().max_by_key(|up| self.ups[*up]);
        estimate.up = Up(most.unwrap_or(0));
        let [height_m, others @ ..] = self.grounds.each_mut().map(|values| median(values));
        estimate.height_m = height_m;
        [estimate.pitch_deg, estimate.roll_deg] = others.map(Option::unwrap_or_default);
        self.content.tell(estimate);
        estimate.azimuth_step_deg = self.steps.step_deg();
        let [top, bottom] = [0.999, 0.001].map(|share| self.elevations.quantile_deg(share));
        estimate.vertical_field_deg = [top, bottom];
        estimate.field_deg = self.directions.field_deg();
        (estimate.range_end_m, estimate.range_end_share) = self.directions.range_end();
        estimate.own_body_deg = self.directions.own_body_deg();
        self.count_beams();
        &self.estimate
    }

    /// Compares the elevation peaks with the returns per column and with the peaks of single scans.
    fn count_beams(&mut self) {
        let estimate = &mut self.estimate;
        self.elevations.find(&mut estimate.elevations_deg);
        let peaks = estimate.elevations_deg.len() as f32;
        let mut counts = *self.directions.counts();
        counts.sort_unstable();
        let many = counts[SECTORS * 9 / 10] as usize * SAMPLE;
        let many = many as f32 / estimate.scans.max(1) as f32;
        // A point and its copy are one return.
        let many = many * (1.0 - estimate.duplicate_share);
        let column = estimate.azimuth_step_deg.map_or(0.0, |step| many * step / SECTOR_DEG);
        // Beams whose returns move from scan to scan have peaks in single scans only.
        let of_scans = median(&mut self.peaks).unwrap_or(0.0);
        let (best, whole) = (peaks.max(of_scans), CLEAR_SHARE * column);
        let has_peaks = best >= BEAMS_MIN && best >= whole;
        estimate.are_beams_clear = has_peaks && peaks >= STAYING_SHARE * best;
        estimate.beams = if has_peaks { best } else { column.round() } as u32;
    }
}

/// Height (m), pitch and roll (degrees).
fn mounting(level: &Level) -> [f32; 3] {
    let [x, y] = level.plane.slope.map(|slope| slope as f32);
    let height_m = level.z_m().abs() / (1.0 + x * x + y * y).sqrt();
    let [pitch_deg, roll_deg] = [x, -y].map(|slope| slope.atan().to_degrees());
    [height_m, pitch_deg, roll_deg]
}

/// The median of the values; sorts them.
fn median(values: &mut [f64]) -> Option<f32> {
    values.sort_unstable_by(f64::total_cmp);
    quantile(values, 0.5).map(|value| value as f32)
}
