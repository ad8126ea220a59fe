//! Turning, shifting up and reordering a scene turns and shifts the boxes and changes nothing else.

mod common;

use common::{box_of, candidate, refine, scan, standing};
use mluc_geometry::{Box3, iou_3d, limit_period};
use mluc_ipc_types::{Detection, Object, Point};
use mluc_refiner::Variant;
use proptest::prelude::*;

const WITHOUT_CHANCE: [Variant; 3] = [Variant::PaperCorrected, Variant::RangeScaled, Variant::None];

fn scene() -> (Vec<Point>, Vec<Detection>) {
    let boxes = [
        standing(11.0, 4.0, [2.6, 1.25, 1.85], 1.1),
        standing(14.0, -6.0, [2.9, 1.2, 2.1], 0.3),
        standing(9.0, -1.5, [0.6, 0.6, 1.7], 0.0),
        standing(-12.0, 3.0, [4.1, 1.7, 1.5], 2.0),
    ];
    let points = scan(&boxes);
    let candidates = boxes.iter().zip([1.0, 2.0, 3.0, 4.0]);
    let candidates = candidates.map(|(b, eds)| candidate(b, [0.4, -0.5], eds));
    (points, candidates.collect())
}

/// A position, turned around the sensor.
fn turned([x, y]: [f64; 2], by_rad: f64) -> [f64; 2] {
    let (sin, cos) = by_rad.sin_cos();
    [x * cos - y * sin, x * sin + y * cos]
}

/// Moves every position of the scene, seen from above.
fn moved(points: &mut [Point], detections: &mut [Detection], to: impl Fn([f64; 2]) -> [f64; 2]) {
    let to = |x: f32, y: f32| to([x, y].map(f64::from)).map(|v| v as f32);
    for p in points {
        [p.x_m, p.y_m] = to(p.x_m, p.y_m);
    }
    for d in detections {
        let [x, y, z] = d.center_m;
        let [x, y] = to(x, y);
        d.center_m = [x, y, z];
    }
}

/// Each object of the scene, before and after a change of the scene.
fn compared(change: impl FnOnce(&mut [Point], &mut [Detection])) -> Vec<(Object, Object)> {
    let (mut points, mut detections) = scene();
    let before = refine(Variant::RangeScaled, &points, &detections);
    change(&mut points, &mut detections);
    let after = refine(Variant::RangeScaled, &points, &detections);
    let pairs = before.objects.into_iter().zip(after.objects);
    pairs.inspect(|(a, b)| assert_eq!(a.disposition, b.disposition)).collect()
}

/// Only two faces of half a metre are seen of a person: several headings fit them equally well, so that the heading may jump.
fn is_small(found: &Box3) -> bool {
    found.size_m[0] < 1.0
}

/// Boxes overlap by more than `least`; position and size of a person agree within a quarter of a metre.
fn is_same(found: &Box3, expected: &Box3, least: f64) -> bool {
    if !is_small(expected) {
        return iou_3d(found, expected) > least;
    }
    let close = |a: &[f64; 3], b: &[f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 0.25);
    close(&found.center_m, &expected.center_m) && close(&found.size_m, &expected.size_m)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 32, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn turning_the_scene_turns_the_boxes(by_rad in -3.1f64..3.1) {
        let pairs = compared(|points, detections| {
            moved(points, detections, |place| turned(place, by_rad));
            detections.iter_mut().for_each(|d| d.yaw_rad += by_rad as f32);
        });
        for (a, b) in &pairs {
            // The cells of ground and clusters lie along the axes: a point at the edge of a cell may change to another cell.
            let apart = a.points_count.abs_diff(b.points_count);
            prop_assert!(100 * apart <= a.points_count, "{} {}", a.points_count, b.points_count);
            let (mut expected, found) = (box_of(a), box_of(b));
            let [x, y, z] = expected.center_m;
            let [x, y] = turned([x, y], by_rad);
            expected.center_m = [x, y, z];
            expected.yaw_rad += by_rad;
            let off = limit_period(found.yaw_rad - expected.yaw_rad, 0.5, std::f64::consts::PI);
            prop_assert!(is_small(&found) || off.abs() < 0.01, "{:?} {:?}", found, expected);
            prop_assert!(is_same(&found, &expected, 0.97), "{:?} {:?}", found, expected);
        }
    }

    #[test]
    fn raising_the_scene_raises_the_boxes(by_m in -3.0f32..3.0) {
        let pairs = compared(|points, detections| {
            points.iter_mut().for_each(|p| p.z_m += by_m);
            detections.iter_mut().for_each(|d| d.center_m[2] += by_m);
        });
        for (a, b) in &pairs {
            let mut expected = box_of(a);
            expected.center_m[2] += f64::from(by_m);
            // Large clusters are thinned for their heading, also by height.
            prop_assert!(iou_3d(&box_of(b), &expected) > 0.95);
        }
    }

    /// This is less exact than raising: reach and ground depend slightly on the position.
    #[test]
    fn shifting_the_scene_shifts_the_boxes(x_m in -1.5f32..1.5, y_m in -1.5f32..1.5) {
        let by = [x_m, y_m].map(f64::from);
        let pairs = compared(|points, detections| moved(points, detections, |[x, y]| [x + by[0], y + by[1]]));
        for (i, (a, b)) in pairs.iter().enumerate() {
            let mut expected = box_of(a);
            expected.center_m[0] += f64::from(x_m);
            expected.center_m[1] += f64::from(y_m);
            let found = box_of(b);
            prop_assert!(is_same(&found, &expected, 0.8), "object {}: {:?} {:?}", i, found, expected);
        }
    }

    #[test]
    fn the_order_of_points_does_not_matter(seed in 1u64..u64::MAX) {
        let (points, detections) = scene();
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_by_key(|&i| (i as u64).wrapping_mul(seed | 1).wrapping_mul(0x9E37_79B9_7F4A_7C15));
        let shuffled: Vec<Point> = order.iter().map(|&i| points[i]).collect();
        for variant in WITHOUT_CHANCE {
            let before = refine(variant, &points, &detections);
            let after = refine(variant, &shuffled, &detections);
            prop_assert_eq!(&before.objects, &after.objects, "{:?}", variant);
            for (a, b) in before.objects.iter().zip(&after.objects) {
                let mut own: Vec<u32> =
                    after.points_of(b).iter().map(|&i| order[i as usize] as u32).collect();
                own.sort_unstable();
                prop_assert_eq!(before.points_of(a), &own[..]);
            }
        }
    }

    #[test]
    fn the_order_of_candidates_does_not_matter(turns in 1usize..4) {
        let (points, detections) = scene();
        let mut permuted = detections.clone();
        permuted.rotate_left(turns);
        for variant in WITHOUT_CHANCE {
            let before = refine(variant, &points, &detections);
            let mut after = refine(variant, &points, &permuted);
            after.objects.rotate_right(turns);
            for (a, b) in before.objects.iter().zip(&after.objects) {
                prop_assert_eq!(box_of(a), box_of(b), "{:?}", variant);
                prop_assert_eq!((a.disposition, a.score, a.points_count), (b.disposition, b.score, b.points_count));
            }
        }
    }
}
