//! Properties of any two boxes, whatever their position and size.

use mluc_geometry::{Box3, Inside, intersection_bev_m2, iou_3d, iou_bev, limit_period, nms_into};
use proptest::prelude::*;
use std::f64::consts::PI;

fn boxes() -> impl Strategy<Value = Box3> {
    (
        (-3.0..3.0f64, -3.0..3.0f64, -1.0..1.0f64),
        (0.05..6.0f64, 0.05..3.0f64, 0.05..3.0f64),
        -7.0..7.0f64,
    )
        .prop_map(|((x, y, z), (l, w, h), yaw)| Box3::new([x, y, z, l, w, h, yaw]))
}

fn nms(boxes: &[Box3], iou_max: f64, kept_max: usize) -> Vec<usize> {
    let order: Vec<usize> = (0..boxes.len()).collect();
    let mut kept = vec![];
    nms_into(boxes, &order, iou_max, kept_max, &mut kept, |_, _, _| ());
    kept
}

/// The box, turned about the sensor and moved.
fn moved(b: &Box3, turn_rad: f64, shift_m: [f64; 3]) -> Box3 {
    let (sin, cos) = turn_rad.sin_cos();
    let ([x, y, z], [dx, dy, dz]) = (b.center_m, shift_m);
    Box3 {
        center_m: [x * cos - y * sin + dx, x * sin + y * cos + dy, z + dz],
        size_m: b.size_m,
        yaw_rad: b.yaw_rad + turn_rad,
    }
}

fn scaled(b: &Box3, factor: f64) -> Box3 {
    Box3 {
        center_m: b.center_m.map(|v| v * factor),
        size_m: b.size_m.map(|v| v * factor),
        yaw_rad: b.yaw_rad,
    }
}

proptest! {
    /// A prepared box agrees with the point's position in the box's own frame.
    #[test]
    fn inside_is_within_half_the_sides(b in boxes(), x in -5.0..5.0f64, y in -5.0..5.0f64, z in -2.0..2.0f64, margin in 0.0..0.5f64) {
        let local = b.local_m([x, y, z]);
        let off = |i: usize| local[i].abs() - b.size_m[i] / 2.0;
        let beyond = off(0).max(off(1)).max(off(2));
        prop_assert_eq!(b.contains([x, y, z]), beyond <= 0.0);
        prop_assert_eq!(Inside::of(&b, margin).contains([x, y, z]), beyond <= margin);
        prop_assert!(!b.contains([f64::NAN, y, z]));
    }

    #[test]
    fn order_does_not_matter(a in boxes(), b in boxes()) {
        prop_assert!((iou_bev(&a, &b) - iou_bev(&b, &a)).abs() < 1e-9);
        prop_assert!((iou_3d(&a, &b) - iou_3d(&b, &a)).abs() < 1e-9);
    }

    #[test]
    fn moving_both_changes_nothing(a in boxes(), b in boxes(), turn in -4.0..4.0f64, x in -80.0..80.0f64, y in -80.0..80.0f64) {
        let (c, d) = (moved(&a, turn, [x, y, 1.0]), moved(&b, turn, [x, y, 1.0]));
        prop_assert!((iou_bev(&a, &b) - iou_bev(&c, &d)).abs() < 1e-9);
        prop_assert!((iou_3d(&a, &b) - iou_3d(&c, &d)).abs() < 1e-9);
    }

    #[test]
    fn scaling_both_changes_nothing(a in boxes(), b in boxes(), factor in 0.01..100.0f64) {
        prop_assert!((iou_3d(&a, &b) - iou_3d(&scaled(&a, factor), &scaled(&b, factor))).abs() < 1e-9);
    }

    #[test]
    fn half_a_turn_and_swapped_sides_are_the_same_box(a in boxes(), b in boxes()) {
        let back = Box3 { yaw_rad: b.yaw_rad + PI, ..b };
        let [l, w, h] = b.size_m;
        let swapped = Box3 { size_m: [w, l, h], yaw_rad: b.yaw_rad + PI / 2.0, ..b };
        prop_assert!((iou_bev(&a, &b) - iou_bev(&a, &back)).abs() < 1e-9);
        prop_assert!((iou_bev(&a, &b) - iou_bev(&a, &swapped)).abs() < 1e-9);
    }

    #[test]
    fn bounded_and_whole_only_for_equal_boxes(a in boxes(), b in boxes()) {
        for iou in [iou_bev(&a, &b), iou_3d(&a, &b)] {
            prop_assert!((0.0..=1.0).contains(&iou));
        }
        prop_assert!((iou_3d(&a, &a) - 1.0).abs() < 1e-9);
        let smaller = (a.size_m[0] * a.size_m[1]).min(b.size_m[0] * b.size_m[1]);
        prop_assert!(intersection_bev_m2(&a, &b) <= smaller);
    }

    /// The area by counting: an independent answer that shares no code with the clipping.
    #[test]
    fn the_area_agrees_with_counting(a in boxes(), b in boxes()) {
        const STEPS: usize = 200;
        let mut inside = 0;
        for i in 0..STEPS {
            for j in 0..STEPS {
                let u = ((i as f64 + 0.5) / STEPS as f64 - 0.5) * a.size_m[0];
                let v = ((j as f64 + 0.5) / STEPS as f64 - 0.5) * a.size_m[1];
                let (sin, cos) = a.yaw_rad.sin_cos();
                let point = [a.center_m[0] + u * cos - v * sin, a.center_m[1] + u * sin + v * cos, b.center_m[2]];
                inside += usize::from(b.contains(point));
            }
        }
        let area_m2 = a.size_m[0] * a.size_m[1];
        let counted_m2 = area_m2 * inside as f64 / (STEPS * STEPS) as f64;
        prop_assert!((intersection_bev_m2(&a, &b) - counted_m2).abs() < 0.02 * area_m2 + 1e-9);
    }

    #[test]
    fn suppression_leaves_no_overlap_and_loses_nothing_without_reason(list in prop::collection::vec(boxes(), 0..40)) {
        let kept = nms(&list, 0.2, usize::MAX);
        for (i, &a) in kept.iter().enumerate() {
            for &b in &kept[..i] {
                prop_assert!(iou_bev(&list[a], &list[b]) <= 0.2);
            }
        }
        for lost in (0..list.len()).filter(|i| !kept.contains(i)) {
            prop_assert!(kept.iter().any(|&k| k < lost && iou_bev(&list[k], &list[lost]) > 0.2));
        }
    }

    #[test]
    fn angles_land_in_their_period(value in -100.0..100.0f64) {
        let v = limit_period(value, 0.5, 2.0 * PI);
        prop_assert!((-PI..PI + 1e-12).contains(&v));
        prop_assert!(((value - v) / (2.0 * PI) - ((value - v) / (2.0 * PI)).round()).abs() < 1e-9);
    }
}
