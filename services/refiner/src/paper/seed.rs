//! Finds the point at which a cluster starts.

use crate::frame::{FrameIndex, IndexedPoint};
use crate::proposal::{ENLARGED, NEAR_M, reach_m};
use mluc_geometry::ground::ground_height_m;
use mluc_geometry::{Box3, Inside, Random};

/// The input of the search for a seed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seek<'a> {
    pub(crate) frame: &'a FrameIndex,
    pub(crate) candidate: &'a Box3,
    pub(crate) ground_m: &'a [f32],
    pub(crate) height_min_m: f64,
}

impl Seek<'_> {
    /// The point nearest to the box's centre among the points that stand on the ground; each read of a point adds to `work`.
    /// The coordinates decide ties, so that the order of the scan does not matter.
    pub(crate) fn nearest_to_center(&self, work: &mut u64) -> Option<IndexedPoint> {
        // Nearly every seed is close; the wide search is for the others.
        let near = self.nearest_within(NEAR_M, work);
        near.or_else(|| self.nearest_within(reach_m(self.candidate), work))
    }

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
                let [px, py, pz] = point.at_m;
                let height_m = pz - ground_height_m(self.ground_m, [px, py]);
                let stands = f64::from(height_m) >= self.height_min_m;
                let own = (full, point.at_m);
                let is_better = |(least, b): (f64, IndexedPoint)| own < (least, b.at_m);
                if stands && best.is_none_or(is_better) {
                    best = Some((full, *point));
                }
            }
        }
        best.map(|(_, point)| point)
    }

    /// A random point inside the box, as the paper prints it: the same for the same frame and detection. A box without a point is enlarged once.
    pub(crate) fn random_inside(
        &self,
        key: (u64, u64),
        found: &mut Vec<IndexedPoint>,
        work: &mut u64,
    ) -> Option<IndexedPoint> {
        let center = [self.candidate.center_m[0], self.candidate.center_m[1]];
        for factor in [1.0, ENLARGED] {
            let enlarged =
                Box3 { size_m: self.candidate.size_m.map(|s| s * factor), ..*self.candidate };
            let inside = Inside::of(&enlarged, 0.0);
            found.clear();
            for row in self.frame.rows_around(center, reach_m(self.candidate)) {
                *work += row.len() as u64;
                let is_inside = |p: &&IndexedPoint| inside.contains(p.at_m.map(f64::from));
                found.extend(row.iter().filter(is_inside));
            }
            if !found.is_empty() {
                // Sorted by the index in the scan, so that the tiles do not matter.
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
    use crate::testing::{point, sorted};
    use mluc_geometry::ground::GROUND_NODES;

    /// The result of `found` for a candidate at `x_m`, 1.9 m long and 1 m wide, among points 0.7 m above the ground.
    fn seek<T>(points_x_m: &[f32], x_m: f64, found: impl FnOnce(Seek) -> T) -> T {
        let scan: Vec<_> = points_x_m.iter().map(|&x| point([x, 0.0, -1.0])).collect();
        found(Seek {
            frame: &sorted(&scan),
            candidate: &Box3::new([x_m, 0.0, -1.0, 1.9, 1.0, 1.5, 0.0]),
            ground_m: &[-1.7; GROUND_NODES],
            height_min_m: 0.2,
        })
    }

    #[test]
    fn the_nearest_standing_point_wins() {
        let xs = [9.0, 10.4, 11.2];
        let mut work = 0;
        let mut found = |x_m, height_min_m| {
            seek(&xs, x_m, |mut seek| {
                seek.height_min_m = height_min_m;
                seek.nearest_to_center(&mut work).map(|p| p.index)
            })
        };
        assert_eq!(found(10.0, 0.2), Some(1));
        assert_eq!(found(10.0, 0.8), None, "none stands so high");
        assert_eq!(found(13.0, 0.2), Some(2));
        assert!(work >= 9, "{work}");
    }

    #[test]
    fn the_random_point_is_inside_and_repeats() {
        let xs = [8.0, 9.6, 10.4, 10.6, 11.05, 15.0];
        let draw = |x_m: f64, key| {
            let random = |seek: Seek| seek.random_inside(key, &mut Vec::new(), &mut 0);
            seek(&xs, x_m, random).map(|p| p.index)
        };
        let mut seen = std::collections::BTreeSet::new();
        for sequence in 0..50 {
            let first = draw(10.0, (sequence, 3));
            assert_eq!(first, draw(10.0, (sequence, 3)));
            seen.extend(first);
        }
        assert!(seen.iter().copied().eq([1, 2, 3]));
        assert_eq!(draw(12.1, (0, 0)), Some(4), "enlarged once");
        assert_eq!(draw(13.0, (0, 0)), None);
    }
}
