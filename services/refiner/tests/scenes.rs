//! What the refiners make of simple scenes.

mod common;

use common::{box_of, candidate, known, point, refine, scan, standing};
use mluc_geometry::{Box3, iou_3d};
use mluc_ipc_types::{Detection, Disposition, Object};
use mluc_refiner::Variant;

const CART: [f64; 3] = [2.6, 1.25, 1.85];
const ORIENTED: [Variant; 2] = [Variant::PaperCorrected, Variant::RangeScaled];

#[test]
fn a_cart_seen_at_its_corner_gets_its_box() {
    let cart = standing(12.0, 5.0, CART, 1.2);
    let points = scan(&[cart, standing(20.0, 5.0, [4.2, 1.8, 1.5], 0.0)]);
    for variant in ORIENTED {
        let out = refine(variant, &points, &[candidate(&cart, [0.6, -0.5], 2.0)]);
        let found = &out.objects[0];
        assert_eq!(
            found.disposition,
            Disposition::Published as u32,
            "{variant:?}"
        );
        let iou = iou_3d(&box_of(found), &cart);
        assert!(iou > 0.7, "{variant:?}: {iou} {:?}", box_of(found));
        let expected = match variant {
            Variant::PaperCorrected => 1.0 / 2.0,
            _ => 0.6 * (2.0 - 1.002),
        };
        assert!(
            (found.score - expected).abs() < 1e-6,
            "{variant:?}: {}",
            found.score
        );
        // Its points are on the cart, and its outline lies around them.
        let own = out.points_of(found);
        assert!(own.len() > 100, "{variant:?}: {}", own.len());
        let grown = Box3 {
            size_m: cart.size_m.map(|s| s + 0.1),
            ..cart
        };
        for &i in own {
            let p = points[i as usize];
            assert!(
                grown.contains([p.x_m, p.y_m, p.z_m].map(f64::from)),
                "{variant:?}"
            );
        }
        assert!((4..=16).contains(&found.footprint_count));
    }
}

#[test]
fn from_its_rear_face_alone_a_cart_is_completed() {
    // Straight ahead, at the height of the sensor: nothing but the rear can be seen.
    let cart = standing(14.0, 0.0, CART, 0.0);
    let points = scan(&[cart]);
    let iou_of = |variant| {
        let out = refine(variant, &points, &[candidate(&cart, [0.5, 0.3], 1.0)]);
        iou_3d(&box_of(&out.objects[0]), &cart)
    };
    let tight = iou_of(Variant::PaperCorrected);
    let completed = iou_of(Variant::RangeScaled);
    assert!(tight < 0.15, "as thin as paper: {tight}");
    assert!(completed > 0.3, "{completed}");
}

/// Through a rear window a few returns come from within: they lie nearest the proposal's centre, and are not the van.
#[test]
fn returns_from_within_a_van_are_not_taken_for_it() {
    let van = standing(14.0, 3.0, [5.0, 1.9, 2.2], 0.3);
    let mut points = scan(&[van]);
    let [x, y, z] = van.center_m;
    let within = (0..12).map(|i| {
        let step = f64::from(i % 4) * 0.08;
        point([x + step, y, z + f64::from(i / 4) * 0.1])
    });
    points.extend(within);
    let proposal = Detection {
        size_m: van.size_m.map(|s| s as f32 + 0.1),
        yaw_rad: van.yaw_rad as f32,
        ..candidate(&van, [0.0, 0.0], 1.0)
    };
    let out = refine(Variant::RangeScaled, &points, &[proposal]);
    let found = box_of(&out.objects[0]);
    let iou = iou_3d(&found, &van);
    assert!(iou > 0.5, "{iou} {found:?}");
}

#[test]
fn an_unknown_beside_a_known_truck_survives() {
    let truck = standing(15.0, 0.0, [8.0, 2.5, 3.2], 0.0);
    // 20 cm beside the truck: closer than any reach of a join.
    let obstacle = standing(13.0, 1.25 + 0.2 + 0.35, [0.8, 0.7, 1.1], 0.0);
    let points = scan(&[truck, obstacle]);
    let detections = [known(&truck, 3, 0.9), candidate(&obstacle, [0.2, 0.3], 1.0)];
    let out = refine(Variant::RangeScaled, &points, &detections);
    let found = &out.objects[1];
    assert_eq!(found.disposition, Disposition::Published as u32);
    let iou = iou_3d(&box_of(found), &obstacle);
    // One face of it is seen, and its depth is a guess.
    assert!(iou > 0.3, "{iou} {:?}", box_of(found));
    let own = out.points_of(found);
    let on_truck = own.iter().filter(|&&i| {
        let p = points[i as usize];
        truck.contains([p.x_m, p.y_m, p.z_m].map(f64::from))
    });
    assert_eq!(on_truck.count(), 0);
}

/// Field complaint: the merger deletes an unknown beside a known truck. Wherever the proposal lies around the obstacle,
/// also half on the truck, the obstacle stays an object of its own.
#[test]
fn an_obstacle_close_to_a_truck_survives_whatever_the_proposal() {
    let truck = standing(15.0, 0.0, [8.0, 2.5, 3.2], 0.0);
    for gap_m in [0.15, 0.3, 0.6] {
        let obstacle = standing(13.0, 1.25 + gap_m + 0.35, [0.8, 0.7, 1.1], 0.0);
        let points = scan(&[truck, obstacle]);
        for degrees in (0..360).step_by(30) {
            let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
            let shift = [0.8 * cos, 0.8 * sin];
            let detections = [known(&truck, 3, 0.9), candidate(&obstacle, shift, 1.0)];
            let out = refine(Variant::RangeScaled, &points, &detections);
            let found = &out.objects[1];
            let what = format!("{gap_m} m, {degrees} degrees: {found:?}");
            assert_eq!(found.disposition, Disposition::Published as u32, "{what}");
            assert!(iou_3d(&box_of(found), &obstacle) > 0.2, "{what}");
        }
    }
}

#[test]
fn a_candidate_on_a_known_object_goes_and_says_why() {
    let car = standing(15.0, 2.0, [4.2, 1.8, 1.5], 0.4);
    let points = scan(&[car]);
    let detections = [candidate(&car, [0.3, 0.3], 1.0), known(&car, 0, 0.9)];
    for variant in [Variant::PaperCorrected, Variant::RangeScaled] {
        let out = refine(variant, &points, &detections);
        assert_eq!(
            out.objects[0].disposition,
            Disposition::OverlapsKnown as u32,
            "{variant:?}"
        );
        assert_eq!(out.objects[0].suppressed_by, 1);
        assert!(out.objects[0].overlap > 0.5 && out.objects[0].overlap <= 1.0);
        let seen = &out.objects[1];
        assert_eq!(
            (seen.disposition, seen.score, seen.footprint_count),
            (0, 0.9, 4)
        );
        assert!(seen.points_count > 100);
    }
}

#[test]
fn too_few_points_are_told_and_what_is_oversized_is_split() {
    let post = standing(30.0, 3.0, [0.05, 0.05, 0.4], 0.0);
    let points = scan(&[post]);
    let out = refine(
        Variant::RangeScaled,
        &points,
        &[candidate(&post, [0.0, 0.0], 1.0)],
    );
    assert_eq!(out.objects[0].disposition, Disposition::TooFewPoints as u32);
    let wall = standing(12.0, 0.0, [0.4, 40.0, 3.0], 0.0);
    let out = refine(
        Variant::RangeScaled,
        &scan(&[wall]),
        &[candidate(&wall, [0.0, 0.0], 1.0)],
    );
    // Never dropped: cut to a road user's length.
    let piece = &out.objects[0];
    assert_eq!(piece.disposition, Disposition::Published as u32);
    assert!(piece.flags & Object::SPLIT != 0);
    assert!(
        piece.size_m[0] > 8.0 && piece.size_m[0] <= 16.0,
        "{:?}",
        piece.size_m
    );
    assert!(piece.points_count > 500);
    assert_eq!(out.counters.split, 1);
}
