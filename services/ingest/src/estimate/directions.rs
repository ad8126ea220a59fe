//! Statistics of each direction around the sensor: returns, the farthest return, near returns.

use mluc_model::{BlindSector, degrees_off};
use smart_default::SmartDefault;
use std::f32::consts::{PI, TAU};

/// Number of sectors of 5 degrees, counted from behind over the right.
pub const SECTORS: usize = 72;
/// Width of a sector, degrees.
pub(super) const SECTOR_DEG: f32 = 360.0 / SECTORS as f32;
/// Nearer returns may be of the vehicle itself, m.
pub(super) const NEAR_M: f32 = 2.5;
/// The fewest sampled near returns in one scan that show something near in a direction.
const NEAR_MIN: u16 = 2;
/// Steps in which the own body's highest elevation is counted, degrees.
const TOP_STEP_DEG: f32 = 5.0;
/// Number of such steps from straight down to straight up.
const TOPS: usize = 36;
/// A direction's farthest return counts as the end of the range if it is at least this share of the usual end.
const END_SHARE: f32 = 0.85;
/// A sector before its first return.
const NOTHING: (u16, u16, f32) = (0, 0, -90.0);

/// Sums over scans, by sector.
#[derive(Clone, Copy, Debug, SmartDefault)]
pub(super) struct Directions {
    #[default([0; SECTORS])]
    counts: [u32; SECTORS],
    #[default([0.0; SECTORS])]
    farthest_m: [f32; SECTORS],
    /// Returns, near returns, and the highest elevation of the near returns in the current scan.
    #[default([NOTHING; SECTORS])]
    scan: [(u16, u16, f32); SECTORS],
    /// Number of scans with returns. It may differ between sectors: the first turn of a capture is incomplete.
    #[default([0; SECTORS])]
    scans: [u16; SECTORS],
    /// Number of scans with something near, by the step of its highest elevation.
    #[default([[0; TOPS]; SECTORS])]
    near_scans: [[u16; TOPS]; SECTORS],
}

/// Azimuth of the middle of a sector, rad.
pub fn direction_rad(sector: usize) -> f32 {
    (sector as f32 + 0.5) * SECTOR_DEG.to_radians() - PI
}

impl Directions {
    /// Adds a return at x, y, z and its range (m). The ground does not count as something near.
    pub(super) fn add(&mut self, [x_m, y_m, z_m]: [f32; 3], range_m: f32, is_ground: bool) {
        let sector = (y_m.atan2(x_m) + PI) / TAU * SECTORS as f32;
        let sector = (sector as usize).min(SECTORS - 1);
        self.counts[sector] += 1;
        self.farthest_m[sector] = self.farthest_m[sector].max(range_m);
        let (returns, near, top_deg) = &mut self.scan[sector];
        *returns = returns.saturating_add(1);
        if range_m < NEAR_M && !is_ground {
            *near = near.saturating_add(1);
            *top_deg = top_deg.max((z_m / range_m).asin().to_degrees());
        }
    }

    pub(super) fn end_scan(&mut self) {
        for (sector, found) in self.scan.iter_mut().enumerate() {
            let (returns, near, top_deg) = std::mem::replace(found, NOTHING);
            self.scans[sector] += u16::from(returns > 0);
            let top = ((top_deg + 90.0) / TOP_STEP_DEG).ceil() as usize;
            self.near_scans[sector][top.clamp(1, TOPS) - 1] += u16::from(near >= NEAR_MIN);
        }
    }

    /// A sector with fewer returns than a tenth of the median sector is empty.
    pub(super) fn is_empty(&self, sector: usize) -> bool {
        let mut counts = self.counts;
        counts.sort_unstable();
        // More than half of the sectors are empty where a sensor looks only ahead: they are left out of the median.
        let filled = counts.iter().position(|count| *count > 0);
        let median = filled.map_or(0, |first| counts[(first + SECTORS) / 2]);
        self.counts[sector] * 10 <= median
    }

    /// Middle and width of the field, degrees: everything except the largest gap.
    pub(super) fn field_deg(&self) -> [f32; 2] {
        let (mut gap, mut gap_end, mut run) = (0, 0, 0);
        for step in 0..2 * SECTORS {
            let is_empty = self.is_empty(step % SECTORS);
            run = if is_empty { run + 1 } else { 0 };
            if run > gap && run <= SECTORS {
                (gap, gap_end) = (run, step + 1);
            }
        }
        if gap < 2 {
            return [0.0, 360.0];
        }
        let width = (SECTORS - gap) as f32 * SECTOR_DEG;
        let first_deg = gap_end as f32 * SECTOR_DEG - 180.0;
        let middle = first_deg + width / 2.0;
        [middle - 360.0 * ((middle + 180.0) / 360.0).floor(), width]
    }

    /// Where the range ends: the 95th percentile of the farthest returns in all directions (m), and the share of directions that end about there.
    pub(super) fn range_end(&self) -> (f32, f32) {
        let mut ends = self.farthest_m;
        ends.sort_unstable_by(f32::total_cmp);
        let first = ends.iter().position(|end| *end > 0.0).unwrap_or(0);
        let ends = &ends[first..];
        let Some(&end) = ends.get(ends.len() * 19 / 20).filter(|end| **end > 0.0) else {
            return (0.0, 0.0);
        };
        let near_it = ends.iter().filter(|far| **far >= END_SHARE * end).count();
        (end, near_it as f32 / ends.len() as f32)
    }

    /// Degrees of the directions in which every scan has something near; 0 after fewer than three scans.
    pub(super) fn own_body_deg(&self) -> f32 {
        let stays = (0..SECTORS).filter(|sector| self.own_body_top_deg(*sector).is_some());
        stays.count() as f32 * SECTOR_DEG
    }

    /// Highest elevation of what is near in every scan, of at least three, degrees: the median of the scans, since other objects pass by.
    fn own_body_top_deg(&self, sector: usize) -> Option<f32> {
        let (near, scans) = (&self.near_scans[sector], self.scans[sector]);
        let most = self.scans.iter().max().copied().unwrap_or(0);
        if scans < 3 || 2 * scans < most || near.iter().sum::<u16>() < scans {
            return None;
        }
        let mut sum = 0;
        let median = near.iter().position(|count| {
            sum += count;
            2 * sum >= scans
        });
        Some((median? + 1) as f32 * TOP_STEP_DEG - 90.0)
    }

    /// What the own body hides inside of the field: directions with something near in every scan, up to its highest elevation, and
    /// whole directions without returns. Neighbours with the same highest elevation are one sector.
    pub(super) fn blind(&self) -> Vec<BlindSector> {
        let [middle_deg, width_deg] = self.field_deg();
        let below_deg: [_; SECTORS] = std::array::from_fn(|sector| {
            let azimuth_deg = direction_rad(sector).to_degrees();
            let is_inside = degrees_off(azimuth_deg, middle_deg) < width_deg / 2.0;
            let is_empty = is_inside && self.is_empty(sector);
            is_empty.then_some(90.0).or_else(|| self.own_body_top_deg(sector))
        });
        let mut from_deg = -180.0;
        let alike = below_deg.chunk_by(|a, b| a == b).filter_map(|alike| {
            let width_deg = alike.len() as f32 * SECTOR_DEG;
            from_deg += width_deg;
            Some(BlindSector {
                azimuth_deg: [from_deg - width_deg / 2.0, width_deg],
                below_deg: alike[0]?,
            })
        });
        alike.collect()
    }

    /// Number of returns in each sector.
    pub(super) fn counts(&self) -> &[u32; SECTORS] {
        &self.counts
    }
}
