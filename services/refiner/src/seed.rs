//! Where a cluster starts.

use mluc_geometry::Box3;

use crate::frame::{FrameIndex, IndexedPoint};
use crate::ground::GroundPlane;
use crate::inside::Inside;

/// Seeds are looked for at least this far from the box's centre, m: a proposal may lie a metre off, and of a long
/// object often only the far end is seen.
const REACH_MIN_M: f64 = 4.0;
/// A seed this near is looked for first, m.
const REACH_FIRST_M: f64 = 1.5;
/// Boxes may be larger than any object; seeds are not looked for further than this, m.
const REACH_MAX_M: f64 = 10.0;
/// A box without a point is enlarged once by this factor.
const ENLARGED: f64 = 1.2;

/// How far from a box's centre seeds are looked for, m: its enlarged corners, within bounds.
pub(crate) fn reach_m(candidate: &Box3) -> f64 {
    let half_diagonal = candidate.size_m[0].hypot(candidate.size_m[1]) / 2.0;
    (half_diagonal * ENLARGED).clamp(REACH_MIN_M, REACH_MAX_M)
}

/// What seeds are looked for in.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seek<'a> {
    pub(crate) frame: &'a FrameIndex,
    pub(crate) candidate: &'a Box3,
    pub(crate) ground: &'a GroundPlane,
    /// Lowest and highest height above the ground, m.
    pub(crate) height_m: [f64; 2],
    /// Points that are passed over, ascending: they gave too small a cluster.
    pub(crate) tried: &'a [u32],
    /// Of each point of the scan whether a known object owns it; empty: none does.
    pub(crate) is_known: &'a [bool],
}

impl Seek<'_> {
    /// The point nearest the box's centre among those that stand on the ground; points looked at are added to `work`.
    /// Close by, points that no known object owns come first: what stands beside a truck is nearer to it than a
    /// proposal is exact. Ties go by the coordinates, so that the order of the scan does not matter.
    pub(crate) fn nearest_to_center(&self, work: &mut u64) -> Option<IndexedPoint> {
        // Nearly every seed lies close by; the wide search is for the others.
        let wide_m = reach_m(self.candidate);
        let near = self.nearest_within(REACH_FIRST_M, work);
        let is_near = |found: &&(f64, IndexedPoint)| found.0 <= REACH_FIRST_M * REACH_FIRST_M;
        if let Some((_, point)) = near.free.iter().find(is_near) {
            return Some(*point);
        }
        if let Some((_, point)) = near.owned.iter().find(is_near) {
            return Some(*point);
        }
        let far = self.nearest_within(wide_m, work);
        let by_distance = |found: &(f64, IndexedPoint)| found.0;
        match (far.free, far.owned) {
            (Some(free), Some(owned)) if by_distance(&owned) < by_distance(&free) => Some(owned.1),
            (free, owned) => free.or(owned).map(|(_, point)| point),
        }
    }

    /// The nearest points within a horizontal reach, and their squared distances in space, m^2.
    fn nearest_within(&self, reach_m: f64, work: &mut u64) -> Nearest {
        let [cx, cy, cz] = self.candidate.center_m;
        let mut best = Nearest::default();
        for row in self.frame.rows_around([cx, cy], reach_m) {
            *work += row.len() as u64;
            for point in row {
                let [x, y, z] = point.at_m.map(f64::from);
                let (dx, dy, dz) = (x - cx, y - cy, z - cz);
                let flat = dx * dx + dy * dy;
                let full = flat + dz * dz;
                if flat > reach_m * reach_m || best.free.is_some_and(|(least, _)| full > least) {
                    continue;
                }
                let height = z - self.ground.z_at_m(x, y);
                if height < self.height_m[0] || height > self.height_m[1] {
                    continue;
                }
                let is_owned = self.is_known.get(point.index as usize) == Some(&true);
                let best = match is_owned {
                    true => &mut best.owned,
                    false => &mut best.free,
                };
                let better = best.is_none_or(|(least, b)| {
                    full < least || (full == least && point.at_m < b.at_m)
                });
                if better && self.tried.binary_search(&point.index).is_err() {
                    *best = Some((full, *point));
                }
            }
        }
        best
    }

    /// A random point inside the box, as the paper prints it: the same for the same frame and detection. A box without
    /// a point is enlarged once.
    pub(crate) fn random_inside(
        &self,
        key: (u64, u64),
        found: &mut Vec<IndexedPoint>,
        work: &mut u64,
    ) -> Option<IndexedPoint> {
        let center = [self.candidate.center_m[0], self.candidate.center_m[1]];
        for factor in [1.0, ENLARGED] {
            let enlarged = Box3 {
                size_m: self.candidate.size_m.map(|s| s * factor),
                ..*self.candidate
            };
            let inside = Inside::of(&enlarged, 0.0);
            found.clear();
            for row in self.frame.rows_around(center, reach_m(self.candidate)) {
                *work += row.len() as u64;
                found.extend(row.iter().filter(|p| inside.contains(p.at_m)));
            }
            if !found.is_empty() {
                // By their place in the scan, whatever the cells.
                found.sort_unstable_by_key(|point| point.index);
                let draw = split_mix(key.0 ^ split_mix(key.1)) % found.len() as u64;
                return found.get(draw as usize).copied();
            }
        }
        None
    }
}

/// The nearest point that no known object owns, and the nearest that one does.
#[derive(Clone, Copy, Debug, Default)]
struct Nearest {
    free: Option<(f64, IndexedPoint)>,
    owned: Option<(f64, IndexedPoint)>,
}

/// SplitMix64 (Steele, Lea and Flood, 2014): one step.
fn split_mix(state: u64) -> u64 {
    let z = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_ipc_types::Point;

    fn frame(xs: &[f32]) -> FrameIndex {
        let scan: Vec<Point> = xs
            .iter()
            .map(|&x_m| Point {
                x_m,
                y_m: 0.0,
                z_m: -1.0,
                intensity: 0.0,
            })
            .collect();
        let mut frame = FrameIndex::default();
        frame.start();
        frame.want([10.0, 0.0], 12.0);
        frame.sort(&scan);
        frame
    }

    fn seek<'a>(
        frame: &'a FrameIndex,
        candidate: &'a Box3,
        ground: &'a GroundPlane,
        tried: &'a [u32],
        is_known: &'a [bool],
    ) -> Seek<'a> {
        Seek {
            frame,
            candidate,
            ground,
            height_m: [0.2, 4.0],
            tried,
            is_known,
        }
    }

    #[test]
    fn the_nearest_standing_point_wins() {
        let frame = frame(&[9.0, 10.4, 11.2]);
        let candidate = Box3::new([10.0, 0.0, -1.0, 2.0, 1.0, 1.5, 0.0]);
        let ground = GroundPlane::flat([10.0, 0.0], 1.7);
        let mut work = 0;
        let found = |candidate: &Box3, tried: &[u32], work: &mut u64| {
            let seek = seek(&frame, candidate, &ground, tried, &[]);
            seek.nearest_to_center(work).map(|p| p.index)
        };
        assert_eq!(found(&candidate, &[], &mut work), Some(1));
        assert_eq!(work, 3);
        let above = Seek {
            height_m: [0.8, 4.0],
            ..seek(&frame, &candidate, &ground, &[], &[])
        };
        assert!(above.nearest_to_center(&mut work).is_none());
        let far = Box3::new([13.0, 0.0, -1.0, 2.0, 1.0, 1.5, 0.0]);
        assert_eq!(
            found(&far, &[2], &mut work),
            Some(1),
            "the nearest one was tried"
        );
    }

    #[test]
    fn what_a_known_object_owns_comes_second_close_by() {
        let frame = frame(&[9.0, 10.4, 14.0]);
        let candidate = Box3::new([10.0, 0.0, -1.0, 2.0, 1.0, 1.5, 0.0]);
        let ground = GroundPlane::flat([10.0, 0.0], 1.7);
        let found = |is_known: &[bool]| {
            let seek = seek(&frame, &candidate, &ground, &[], is_known);
            seek.nearest_to_center(&mut 0).map(|p| p.index)
        };
        assert_eq!(found(&[false, true, false]), Some(0));
        assert_eq!(
            found(&[true, true, false]),
            Some(1),
            "farther things are others'"
        );
        assert_eq!(found(&[true, true, true]), Some(1));
    }

    #[test]
    fn the_random_point_is_inside_and_repeats() {
        let frame = frame(&[8.0, 9.6, 10.4, 10.6, 11.05, 15.0]);
        let ground = GroundPlane::flat([10.0, 0.0], 1.7);
        let candidate = Box3::new([10.0, 0.0, -1.0, 2.0, 1.0, 1.5, 0.0]);
        let mut found = Vec::new();
        let mut draw = |b: &Box3, key| {
            let seek = seek(&frame, b, &ground, &[], &[]);
            seek.random_inside(key, &mut found, &mut 0).map(|p| p.index)
        };
        let mut seen = std::collections::BTreeSet::new();
        for sequence in 0..50 {
            let first = draw(&candidate, (sequence, 3));
            assert_eq!(first, draw(&candidate, (sequence, 3)));
            seen.extend(first);
        }
        assert!(seen.iter().copied().eq([1, 2, 3]));
        let beside = Box3::new([12.0, 0.0, -1.0, 1.8, 1.0, 1.5, 0.0]);
        assert_eq!(draw(&beside, (0, 0)), Some(4), "enlarged once");
        let far = Box3::new([13.0, 0.0, -1.0, 1.8, 1.0, 1.5, 0.0]);
        assert_eq!(draw(&far, (0, 0)), None);
    }
}
