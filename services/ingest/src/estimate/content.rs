//! Statistics of the points' numbers: ranges and their unit, zeros, points that are there twice, intensities.

use super::{SensorEstimate, Unit};
use mluc_ipc_types::Point;

/// Ranges are counted by their exponent and three more bits: eight bins per octave.
const RANGE_SHIFT: u32 = 20;
const RANGE_BINS: usize = 1 << (31 - RANGE_SHIFT);
/// Half of the returns of a sensor lie nearer than some tens of m. If nearly all ranges are above the last number, a median range above the first is in
/// cm, above the second in mm.
const UNITS_FROM: [f32; 2] = [200.0, 2_000.0];
const UNITS_NEAREST: f32 = 20.0;
/// Share of the returns that may be nearer than the nearest range: from the robot's own body, for instance.
const NEAREST_SHARE: f32 = 0.1;
/// Number of points whose places are compared with the others: missing returns may all lie at one place.
const PLACES: usize = 16;
/// Longer ranges count as this one, in the unit of the scans: squares of enormous coordinates overflow.
const RANGE_MAX: f32 = 1e9;
/// Intensities above 1 in a smaller share of the points are wrong returns; a guess.
const LOUD_SHARE: f32 = 0.001;
/// Only points whose hash is a multiple of this are checked for copies.
const HASH_SHARE: u32 = 64;
const HASHES: usize = 1 << 13;

/// Sums over scans.
#[derive(Clone, Debug, Default)]
pub(super) struct Content {
    scans: u64,
    points: u64,
    not_finite: u64,
    sampled: u64,
    zeros: u64,
    hashed: u64,
    duplicates: u64,
    /// Sampled points at the commonest place of each scan.
    repeats: u64,
    ranges: Vec<u32>,
    hashes: Vec<u32>,
    intensity_max: f32,
    /// Points with intensities above 1.
    loud: u64,
    /// Unit estimated with the last scan.
    pub(super) unit: Unit,
}

impl Content {
    /// Forgets all scans; allocates its memory the first time.
    pub(super) fn clear(&mut self) {
        *self = Content {
            ranges: std::mem::take(&mut self.ranges),
            hashes: std::mem::take(&mut self.hashes),
            ..Content::default()
        };
        self.ranges.clear();
        self.ranges.resize(RANGE_BINS, 0);
        self.hashes.resize(HASHES, 0);
    }

    pub(super) fn add_scan(&mut self, points: &[Point], not_finite: u32, sample: usize) {
        self.scans += 1;
        self.points += points.len() as u64 + u64::from(not_finite);
        self.not_finite += u64::from(not_finite);
        self.hashes.fill(0);
        for point in points {
            let hash = hash(point);
            if hash.is_multiple_of(HASH_SHARE) && hash != 0 {
                self.hashed += 1;
                self.duplicates += u64::from(self.is_known(hash));
            }
        }
        for point in points.iter().step_by(sample) {
            let [x, y, z] = [point.x_m, point.y_m, point.z_m];
            let range = (x * x + y * y + z * z).sqrt().min(RANGE_MAX);
            self.sampled += 1;
            if range < 1e-3 {
                self.zeros += 1;
            } else {
                self.ranges[(range.to_bits() >> RANGE_SHIFT) as usize % RANGE_BINS] += 1;
                self.loud += u64::from(point.intensity > 1.001);
                self.intensity_max = self.intensity_max.max(point.intensity);
            }
        }
        // An odd step meets every second point too.
        let places = points.iter().step_by((points.len() / PLACES) | 1);
        let repeats = places.map(|place| {
            let place = [place.x_m, place.y_m, place.z_m];
            let is_there = |point: &&Point| [point.x_m, point.y_m, point.z_m] == place;
            let same = points.iter().step_by(sample).filter(is_there).count();
            same as u64 * u64::from(place != [0.0; 3])
        });
        self.repeats += repeats.max().unwrap_or(0).saturating_sub(1);
        let [half, nearest] = [0.5, NEAREST_SHARE].map(|share| self.range(share));
        let is_beyond = |least: &&f32| half > **least && nearest > UNITS_NEAREST;
        self.unit = Unit(UNITS_FROM.iter().filter(is_beyond).count());
    }

    /// Whether a hash is in the table already. Adds it, as long as there is room.
    fn is_known(&mut self, hash: u32) -> bool {
        let first = (hash / HASH_SHARE) as usize;
        for step in 0..8 {
            let place = &mut self.hashes[(first + step) % HASHES];
            if *place == hash {
                return true;
            }
            if *place == 0 {
                *place = hash;
                return false;
            }
        }
        false
    }

    /// Range below which a share of the returns lies, in the unit of the scans.
    fn range(&self, share: f32) -> f32 {
        let all: u64 = self.ranges.iter().map(|count| u64::from(*count)).sum();
        let mut below = 0;
        let reaches = |count: &u32| {
            below += u64::from(*count);
            below as f32 > share * all as f32
        };
        let bin = self.ranges.iter().position(reaches).unwrap_or(0);
        // The middle of the bin.
        f32::from_bits(((bin as u32) << RANGE_SHIFT) | (1 << (RANGE_SHIFT - 1)))
    }

    pub(super) fn tell(&self, estimate: &mut SensorEstimate) {
        let share = |part: u64, whole: u64| part as f32 / whole.max(1) as f32;
        estimate.points = (self.points / self.scans.max(1)) as u32;
        estimate.not_finite_share = share(self.not_finite, self.points);
        estimate.zero_share = share(self.zeros, self.sampled);
        estimate.duplicate_share = share(self.duplicates, self.hashed);
        estimate.repeat_share = share(self.repeats, self.sampled);
        estimate.unit = self.unit;
        estimate.range_nearest_m = self.range(NEAREST_SHARE) * self.unit.in_m();
        estimate.range_median_m = self.range(0.5) * self.unit.in_m();
        estimate.range_longest_m = self.range(0.999) * self.unit.in_m();
        // A few wrong returns do not show another scale.
        let is_loud = share(self.loud, self.sampled) > LOUD_SHARE;
        let most = if is_loud { f32::MAX } else { 1.0 };
        estimate.intensity_max = self.intensity_max.min(most);
    }
}

/// Hash of a point's place; 0 for a point at the origin.
fn hash(point: &Point) -> u32 {
    let [x, y, z] = [point.x_m, point.y_m, point.z_m].map(f32::to_bits);
    let [x, y] = [x.wrapping_mul(0x9E37_79B1), y.wrapping_mul(0x85EB_CA6B)];
    let mixed = x ^ y.rotate_left(11) ^ z.wrapping_mul(0xC2B2_AE35).rotate_left(22);
    let mixed = (mixed ^ mixed >> 15).wrapping_mul(0x2C1B_3C6D);
    mixed ^ mixed >> 13
}
