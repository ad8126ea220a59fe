//! Where a cluster starts.

use mluc_geometry::{Box3, Random};

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
}

impl Seek<'_> {
    /// The point nearest the box's centre among those that stand on the ground; points looked at are added to `work`.
    /// Ties go by the coordinates, so that the order of the scan does not matter.
    pub(crate) fn nearest_to_center(&self, work: &mut u64) -> Option<IndexedPoint> {
        // Nearly every seed lies close by; the wide search is for the others.
        let near = self.nearest_within(REACH_FIRST_M, work);
        near.or_else(|| self.nearest_within(reach_m(self.candidate), work))
    }

    /// The nearest point within a horizontal reach, m.
    fn nearest_within(&self, reach_m: f64, work: &mut u64) -> Option<IndexedPoint> {
        let [cx, cy, cz] = self.candidate.center_m;
        let mut best: Option<(f64, IndexedPoint)> = None;
        for row in self.frame.rows_around([cx, cy], reach_m) {
            *work += row.len() as u64;
            for point in row {
                let [x, y, z] = point.at_m.map(f64::from);
                let (dx, dy, dz) = (x - cx, y - cy, z - cz);
                let flat = dx * dx + dy * dy;
                let full = flat + dz * dz;
                if flat > reach_m * reach_m || best.is_some_and(|(least, _)| full > least) {
                    continue;
                }
                let height = z - self.ground.z_at_m(x, y);
                if height < self.height_m[0] || height > self.height_m[1] {
                    continue;
                }
                if best
                    .is_none_or(|(least, b)| full < least || (full == least && point.at_m < b.at_m))
                {
                    best = Some((full, *point));
                }
            }
        }
        best.map(|(_, point)| point)
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
                let mix = |state| Random::from_state(state).bits();
                let draw = mix(key.0 ^ mix(key.1)) % found.len() as u64;
                return found.get(draw as usize).copied();
            }
        }
        None
    }
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

    fn seek<'a>(frame: &'a FrameIndex, candidate: &'a Box3, ground: &'a GroundPlane) -> Seek<'a> {
        Seek {
            frame,
            candidate,
            ground,
            height_m: [0.2, 4.0],
        }
    }

    #[test]
    fn the_nearest_standing_point_wins() {
        let frame = frame(&[9.0, 10.4, 11.2]);
        let candidate = Box3::new([10.0, 0.0, -1.0, 2.0, 1.0, 1.5, 0.0]);
        let ground = GroundPlane::flat([10.0, 0.0], 1.7);
        let mut work = 0;
        let found = |candidate: &Box3, work: &mut u64| {
            let seek = seek(&frame, candidate, &ground);
            seek.nearest_to_center(work).map(|p| p.index)
        };
        assert_eq!(found(&candidate, &mut work), Some(1));
        assert_eq!(work, 3);
        let above = Seek {
            height_m: [0.8, 4.0],
            ..seek(&frame, &candidate, &ground)
        };
        assert!(above.nearest_to_center(&mut work).is_none());
        let far = Box3::new([13.0, 0.0, -1.0, 2.0, 1.0, 1.5, 0.0]);
        assert_eq!(found(&far, &mut work), Some(2));
    }

    #[test]
    fn the_random_point_is_inside_and_repeats() {
        let frame = frame(&[8.0, 9.6, 10.4, 10.6, 11.05, 15.0]);
        let ground = GroundPlane::flat([10.0, 0.0], 1.7);
        let candidate = Box3::new([10.0, 0.0, -1.0, 2.0, 1.0, 1.5, 0.0]);
        let mut found = Vec::new();
        let mut draw = |b: &Box3, key| {
            let seek = seek(&frame, b, &ground);
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
