//! Overlap of two upright boxes, rotated in bird's-eye view (BEV) and in 3D; non-maximum suppression.
//!
//! All arithmetic is f64. A box with a size that is not positive, or with a coordinate that is not finite, overlaps nothing.

use crate::{boxes::Box3, polygon::Polygon};

/// Four corners, and at most one more for each of four cuts.
const CORNERS_MAX: usize = 8;

fn has_footprint(b: &Box3) -> bool {
    let ([l, w, _], [x, y, _]) = (b.size_m, b.center_m);
    l > 0.0 && w > 0.0 && [l, w, x, y, b.yaw_rad].iter().all(|v| v.is_finite())
}

/// Area of the footprint, m^2; 0 when it is degenerate.
fn footprint_m2(b: &Box3) -> f64 {
    let area_m2 = b.size_m[0] * b.size_m[1];
    if has_footprint(b) { area_m2 } else { 0.0 }
}

/// Whether the circles around two footprints may touch: a cheap test before the exact one.
///
/// The bound `(r_a + r_b)^2 <= 2 (r_a^2 + r_b^2)`, with equality for equal radii, avoids the square roots.
fn circles_may_touch(a: &Box3, b: &Box3) -> bool {
    let (dx, dy) = (a.center_m[0] - b.center_m[0], a.center_m[1] - b.center_m[1]);
    let diagonal_m2 = |b: &Box3| b.size_m[0] * b.size_m[0] + b.size_m[1] * b.size_m[1];
    dx * dx + dy * dy <= (diagonal_m2(a) + diagonal_m2(b)) / 2.0
}

/// Area common to the two footprints, m^2.
pub fn intersection_bev_m2(a: &Box3, b: &Box3) -> f64 {
    if !circles_may_touch(a, b) || !has_footprint(a) || !has_footprint(b) {
        return 0.0;
    }
    // b in a's frame: a's sides are then x = +-l/2 and y = +-w/2, and the arithmetic stays near the origin.
    let b_in_a = Box3 { center_m: a.local_m(b.center_m), yaw_rad: b.yaw_rad - a.yaw_rad, ..*b };
    let (half_l, half_w) = (a.size_m[0] / 2.0, a.size_m[1] / 2.0);
    let common = Polygon::<CORNERS_MAX>::new(b_in_a.footprint_m())
        .cut([1.0, 0.0], half_l)
        .cut([-1.0, 0.0], half_l)
        .cut([0.0, 1.0], half_w)
        .cut([0.0, -1.0], half_w);
    common.area().min(footprint_m2(a)).min(footprint_m2(b))
}

fn intersection_height_m(a: &Box3, b: &Box3) -> f64 {
    // Relative to a's centre, so that the overlap of equal boxes is exactly their height.
    let dz = b.center_m[2] - a.center_m[2];
    let top = (a.size_m[2] / 2.0).min(dz + b.size_m[2] / 2.0);
    let bottom = (-a.size_m[2] / 2.0).max(dz - b.size_m[2] / 2.0);
    let (common, are_boxes) = (top - bottom, a.size_m[2] > 0.0 && b.size_m[2] > 0.0);
    if are_boxes { common.max(0.0) } else { 0.0 }
}

fn ratio(part: f64, whole: f64) -> f64 {
    let (share, is_some) = (part / whole, part > 0.0 && whole > 0.0);
    if is_some { share.min(1.0) } else { 0.0 }
}

/// Intersection over union of the footprints, 0..1.
pub fn iou_bev(a: &Box3, b: &Box3) -> f64 {
    let common = intersection_bev_m2(a, b);
    ratio(common, footprint_m2(a) + footprint_m2(b) - common)
}

/// Intersection over union of the volumes, 0..1.
pub fn iou_3d(a: &Box3, b: &Box3) -> f64 {
    let height = intersection_height_m(a, b);
    if height <= 0.0 {
        return 0.0;
    }
    let common = intersection_bev_m2(a, b) * height;
    ratio(common, a.volume_m3() + b.volume_m3() - common)
}

/// Area common to the footprints over the smaller footprint's area, 0..1: 1 when one contains the other.
pub fn intersection_over_min_area(a: &Box3, b: &Box3) -> f64 {
    let smaller_m2 = footprint_m2(a).min(footprint_m2(b));
    ratio(intersection_bev_m2(a, b), smaller_m2)
}

/// Keeps a box when its rotated BEV IoU with every box kept before is at most `iou_max`.
///
/// `order` lists indices into `boxes`, best first; indices beyond the boxes are skipped. `kept` is cleared, then gets at most `kept_max`
/// indices, best first, without allocation when its capacity is `kept_max`; the function returns when it is full. Until then it calls
/// `suppressed(number, index, iou)` for each suppressed box: `number` is the position in `kept` of the best box that overlaps it.
pub fn nms_into(
    boxes: &[Box3],
    order: &[usize],
    iou_max: f64,
    kept_max: usize,
    kept: &mut Vec<usize>,
    mut suppressed: impl FnMut(usize, usize, f64),
) {
    kept.clear();
    for &index in order {
        if kept.len() == kept_max {
            return;
        }
        let Some(candidate) = boxes.get(index) else {
            continue;
        };
        // `iou_bev` first compares the circles around the boxes, which rejects nearly every pair of a scene.
        let overlaps = kept.iter().map(|&other| iou_bev(&boxes[other], candidate));
        match overlaps.enumerate().find(|(_, iou)| *iou > iou_max) {
            Some((number, iou)) => suppressed(number, index, iou),
            None => kept.push(index),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unit_squares_at_45_degrees() {
        let a = Box3::new([10.0, 5.0, 0.0, 1.0, 1.0, 1.0, 0.0]);
        let b = Box3 { yaw_rad: std::f64::consts::FRAC_PI_4, ..a };
        // The common octagon: 2 (sqrt 2 - 1) = 0.8284 of 1.1716.
        let common = 2.0 * (2f64.sqrt() - 1.0);
        assert!((intersection_bev_m2(&a, &b) - common).abs() < 1e-12);
        assert!((iou_bev(&a, &b) - common / (2.0 - common)).abs() < 1e-12);
        assert!((iou_bev(&a, &b) - std::f64::consts::FRAC_1_SQRT_2).abs() < 1e-4);
    }

    #[test]
    fn containment_gives_the_ratio_of_areas_and_volumes() {
        let a = Box3::new([3.0, 1.0, 0.5, 8.0, 8.0, 4.0, 0.3]);
        let b = Box3::new([3.2, 0.9, 0.5, 2.0, 1.0, 2.0, 1.1]);
        assert!((iou_bev(&a, &b) - 2.0 / 64.0).abs() < 1e-12);
        assert!((iou_3d(&a, &b) - 4.0 / 256.0).abs() < 1e-12);
        assert!((intersection_over_min_area(&a, &b) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn degenerate_boxes_overlap_nothing() {
        let a = Box3::new([0.0, 0.0, 0.0, 4.0, 2.0, 1.0, 0.0]);
        for bad in [0.0, -1.0, -1000.0, f64::NAN, f64::INFINITY] {
            for axis in 0..3 {
                let mut b = a;
                b.size_m[axis] = bad;
                // An infinite height is a column: the IoU only has to be a fraction.
                let iou = iou_3d(&a, &b);
                assert!((0.0..=1.0).contains(&iou), "{iou}");
                assert!(axis == 2 || iou_bev(&a, &b) == 0.0);
                assert_eq!(iou_3d(&b, &b), 0.0);
            }
        }
        let lost = Box3 { center_m: [f64::NAN, 0.0, 0.0], ..a };
        assert_eq!(iou_bev(&a, &lost), 0.0);
    }

    fn at(x: f64, yaw: f64) -> Box3 {
        Box3::new([x, 0.0, 0.0, 4.0, 2.0, 1.5, yaw])
    }

    #[test]
    fn the_best_of_an_overlapping_pair_stays() {
        let pair = [at(0.0, 0.0), at(0.5, 0.1), at(10.0, 0.0)];
        // 0 and 1 overlap, 1 and 2 overlap, 0 and 2 do not: a suppressed box does not suppress.
        let chain = [at(0.0, 0.0), at(3.0, 0.0), at(6.0, 0.0)];
        let kept = |boxes: &[Box3], order: &[usize], iou_max: f64, kept_max: usize| {
            let mut kept = vec![9];
            nms_into(boxes, order, iou_max, kept_max, &mut kept, |_, _, _| ());
            kept
        };
        assert_eq!(kept(&pair, &[1, 0, 2], 0.1, 10), [1, 2]);
        assert_eq!(kept(&pair, &[0, 1, 2], 0.1, 10), [0, 2]);
        assert_eq!(kept(&pair, &[0, 1, 2], 0.1, 1), [0]);
        assert_eq!(kept(&pair, &[0, 1, 2], 0.99, 10), [0, 1, 2]);
        assert_eq!(kept(&chain, &[0, 1, 2], 0.0, 10), [0, 2]);
        let mut told = vec![];
        nms_into(&chain, &[0, 1, 2], 0.0, 10, &mut vec![], |number, index, _| {
            told.push((number, index));
        });
        assert_eq!(told, [(0, 1)]);
        assert!(kept(&[], &[], 0.5, 10).is_empty());
        // An index beyond the boxes.
        assert_eq!(kept(&pair[..1], &[7, 0], 0.5, 10), [0]);
    }
}
