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

/// The point nearest the box's centre among those that stand on the ground; points looked at are added to `work`.
/// Points that were `tried` are passed over. Ties go by the coordinates, so that the order of the scan does not matter.
pub(crate) fn nearest_to_center(
    frame: &FrameIndex,
    candidate: &Box3,
    ground: &GroundPlane,
    height_m: [f64; 2],
    tried: &[u32],
    work: &mut u64,
) -> Option<IndexedPoint> {
    // Nearly every seed lies close by; the wide search is for the others.
    [REACH_FIRST_M, reach_m(candidate)]
        .into_iter()
        .find_map(|reach_m| {
            nearest_within(frame, candidate, ground, height_m, tried, reach_m, work)
                .filter(|(squared, _)| *squared <= reach_m * reach_m || reach_m > REACH_FIRST_M)
                .map(|(_, point)| point)
        })
}

/// The nearest point within a horizontal reach, and its squared distance in space, m^2.
fn nearest_within(
    frame: &FrameIndex,
    candidate: &Box3,
    ground: &GroundPlane,
    height_m: [f64; 2],
    tried: &[u32],
    reach_m: f64,
    work: &mut u64,
) -> Option<(f64, IndexedPoint)> {
    let [cx, cy, cz] = candidate.center_m;
    let mut best: Option<(f64, IndexedPoint)> = None;
    for row in frame.rows_around([cx, cy], reach_m) {
        *work += row.len() as u64;
        for point in row {
            let [x, y, z] = point.at_m.map(f64::from);
            let (dx, dy, dz) = (x - cx, y - cy, z - cz);
            let flat = dx * dx + dy * dy;
            let full = flat + dz * dz;
            if flat > reach_m * reach_m || best.is_some_and(|(least, _)| full > least) {
                continue;
            }
            let height = z - ground.z_at_m(x, y);
            if height < height_m[0] || height > height_m[1] {
                continue;
            }
            let better = best.is_none_or(|(least, b)| full < least || point.at_m < b.at_m);
            if better && !tried.contains(&point.index) {
                best = Some((full, *point));
            }
        }
    }
    best
}

/// A random point inside the box, as the paper prints it: the same for the same frame and detection. A box without a
/// point is enlarged once.
pub(crate) fn random_inside(
    frame: &FrameIndex,
    candidate: &Box3,
    key: (u64, u64),
    found: &mut Vec<IndexedPoint>,
    work: &mut u64,
) -> Option<IndexedPoint> {
    let center = [candidate.center_m[0], candidate.center_m[1]];
    for factor in [1.0, ENLARGED] {
        let enlarged = Box3 {
            size_m: candidate.size_m.map(|s| s * factor),
            ..*candidate
        };
        let inside = Inside::of(&enlarged, 0.0);
        found.clear();
        for row in frame.rows_around(center, reach_m(candidate)) {
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

    #[test]
    fn the_nearest_standing_point_wins() {
        let frame = frame(&[9.0, 10.4, 11.2]);
        let candidate = Box3::new([10.0, 0.0, -1.0, 2.0, 1.0, 1.5, 0.0]);
        let ground = GroundPlane::flat([10.0, 0.0], 1.7);
        let mut work = 0;
        let seed = |low: f64, work: &mut u64| {
            nearest_to_center(&frame, &candidate, &ground, [low, 4.0], &[], work).map(|p| p.index)
        };
        assert_eq!(seed(0.2, &mut work), Some(1));
        assert_eq!(work, 3);
        assert_eq!(seed(0.8, &mut work), None);
        let far = Box3::new([13.0, 0.0, -1.0, 2.0, 1.0, 1.5, 0.0]);
        let found = nearest_to_center(&frame, &far, &ground, [0.2, 4.0], &[2], &mut work);
        assert_eq!(found.map(|p| p.index), Some(1), "the nearest one was tried");
    }

    #[test]
    fn the_random_point_is_inside_and_repeats() {
        let frame = frame(&[8.0, 9.6, 10.4, 10.6, 11.05, 15.0]);
        let candidate = Box3::new([10.0, 0.0, -1.0, 2.0, 1.0, 1.5, 0.0]);
        let mut found = Vec::new();
        let mut draw =
            |b: &Box3, key| random_inside(&frame, b, key, &mut found, &mut 0).map(|p| p.index);
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
