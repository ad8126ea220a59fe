//! One suite that every refiner passes, whatever the input.

mod common;

use common::{
    CART, assert_sound, box_of, candidate, is, known, point, refine, refiner, scan, standing,
};
use mluc_ipc_types::{Detection, Disposition, Flags, Object, Point};
use mluc_refiner::{RefinerOutput, Variant, WORK_MAX};

/// The output of each variant for a frame.
fn refine_all(points: &[Point], detections: &[Detection]) -> Vec<(Variant, RefinerOutput)> {
    let refined = |variant| (variant, refine(variant, points, detections));
    Variant::ALL.into_iter().map(refined).collect()
}

/// Six carts, and a candidate half a metre away from each; the last has the lowest score.
fn carts() -> (Vec<Point>, Vec<Detection>) {
    let place = |k: f64| standing(9.0 + 4.0 * k, 6.0 - 2.5 * k, CART, 0.4);
    let carts: Vec<_> = (0..6).map(f64::from).map(place).collect();
    let candidates = carts.iter().zip(1u8..);
    let candidates = candidates.map(|(cart, k)| candidate(cart, [0.3, -0.3], f32::from(k)));
    (scan(&carts), candidates.collect())
}

#[test]
fn five_hundred_and_twelve_candidates_on_one_spot() {
    let cart = standing(12.0, 1.0, CART, 0.3);
    let spot = |k| candidate(&cart, [0.001 * f64::from(k), 0.0], 1.0 + k as f32);
    let detections: Vec<Detection> = (0..600).map(spot).collect();
    for (variant, out) in refine_all(&scan(&[cart]), &detections) {
        assert_eq!(out.counters.detections_dropped, 88);
        assert!(out.counters.flags().contains(Flags::LIMIT_DETECTIONS));
        if matches!(variant, Variant::PaperCorrected | Variant::RangeScaled) {
            assert!(out.objects[0].is_published(), "the best one stays");
            let covered = out.objects.iter().filter(|o| is(o, Disposition::OverlapsUnknown));
            assert!(covered.count() >= 500, "{variant:?}");
        }
    }
}

/// Point clouds that are no scene, 131,072 points each.
fn clouds() -> [(&'static str, Vec<Point>); 5] {
    let of = |at: fn(f64, [f64; 3]) -> [f64; 3]| {
        let share = |i: usize, k: f64| (i as f64 * k).fract() - 0.5;
        let shares = |i: usize| [0.618_034, 0.414_214, 0.732_051].map(|k| share(i, k));
        (0..131_072).map(|i| point(at(i as f64, shares(i)))).collect()
    };
    let blob = of(|_, [a, b, c]| [12.0 + 3.0 * a, 1.0 + 3.0 * b, 2.0 * c - 0.5]);
    [
        ("all equal", of(|_, _| [12.0, 1.0, -1.0])),
        ("on a line", of(|i, _| [i * 1e-3 - 60.0, 1.0, -0.5])),
        ("one wall", of(|_, [a, b, _]| [12.0, 60.0 * a, 4.0 * b])),
        ("one plane", of(|_, [a, b, _]| [60.0 * a, 60.0 * b, -1.73])),
        ("one blob", blob),
    ]
}

/// Points that lie apart are never joined: an object's points lie in its box, and within reach of each other.
#[test]
fn clouds_that_are_no_scene() {
    const NOISE_M: f64 = 0.05;
    const REACH_M: f64 = 10.0;
    let both = |k| {
        let place = standing(12.0, 1.0 + 0.1 * f64::from(k), CART, 0.0);
        [candidate(&place, [0.0, 0.0], 1.0), known(&place, 0, 0.9)]
    };
    let detections: Vec<Detection> = (0..20).flat_map(both).collect();
    for (name, points) in &clouds() {
        for (variant, out) in refine_all(points, &detections) {
            for object in out.objects.iter().filter(|o| o.is_published()) {
                let shape = box_of(object);
                let mut grown = shape;
                grown.size_m = shape.size_m.map(|side| side + 2.0 * NOISE_M);
                for &index in out.points_of(object) {
                    let p = points[index as usize];
                    let at = [p.x_m, p.y_m, p.z_m].map(f64::from);
                    let off = (at[0] - shape.center_m[0]).hypot(at[1] - shape.center_m[1]);
                    let is_in = grown.contains(at) && off < REACH_M;
                    assert!(is_in, "{name}, {variant:?}: {at:?} in {shape:?}");
                }
            }
        }
    }
}

#[test]
fn detections_that_make_no_sense_are_told() {
    let cart = standing(12.0, 1.0, CART, 0.3);
    let sound = candidate(&cart, [0.4, 0.2], 1.0);
    let mut detections = vec![sound];
    let mut break_one = |change: &dyn Fn(&mut Detection)| {
        for mut broken in [sound, known(&cart, 0, 0.9)] {
            change(&mut broken);
            detections.push(broken);
        }
    };
    for bad in [0.0, -1.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for axis in 0..3 {
            break_one(&|d| d.size_m[axis] = bad);
        }
    }
    for place in [f32::NAN, f32::INFINITY, f32::MAX] {
        break_one(&|d| d.center_m[1] = place);
    }
    break_one(&|d| d.kind = 9);
    break_one(&|d| d.class_id = 77);
    break_one(&|d| d.yaw_rad = f32::NAN);
    for (variant, out) in refine_all(&scan(&[cart]), &detections) {
        let invalid = out.counters.invalid_detections as usize;
        assert_eq!(invalid, detections.len() - 1, "{variant:?}");
        assert!(out.counters.flags().contains(Flags::DEGRADED));
        assert!(out.objects[0].is_published(), "{variant:?}");
        let mut rest = out.objects[1..].iter();
        assert!(rest.all(|o| is(o, Disposition::InvalidBox)));
    }
}

#[test]
fn candidates_far_away_or_of_any_size_are_told() {
    let cart = standing(12.0, 1.0, CART, 0.3);
    let far = standing(5000.0, 1.0, CART, 0.0);
    let mut huge = candidate(&cart, [0.0, 0.0], 1.0);
    huge.size_m = [9000.0; 3];
    let mut tiny = candidate(&cart, [0.0, 0.0], 2.0);
    tiny.size_m = [1e-30; 3];
    let mut worthless = candidate(&cart, [0.0, 0.0], 0.0);
    worthless.eds_normalised = f32::NAN;
    let detections = [candidate(&far, [0.0, 0.0], 1.0), huge, tiny, worthless];
    for (variant, out) in refine_all(&scan(&[cart]), &detections) {
        let has_none = is(&out.objects[0], Disposition::TooFewPoints);
        assert!(variant == Variant::None || has_none, "{variant:?}");
        assert_eq!(out.objects[3].score, 0.0);
    }
}

#[test]
fn when_the_time_is_up_the_worst_candidates_keep_their_proposals() {
    let (points, detections) = carts();
    for variant in [Variant::PaperCorrected, Variant::RangeScaled] {
        let mut out = RefinerOutput::default();
        let mut asked = 0;
        let mut is_over = || {
            asked += 1;
            // Asked once for the clusters, then once for each candidate.
            asked > 3
        };
        let mut refiner = refiner(variant);
        refiner.read_scan(&points);
        refiner.refine_within(0, &points, &detections, &mut is_over, &mut out);
        assert_sound(&points, &detections, &out);
        assert_eq!(out.counters.unrefined, 4, "{variant:?}");
        let without = refine(variant, &points, &detections);
        for (k, object) in out.objects.iter().enumerate() {
            let is_left = object.flags & Object::UNREFINED != 0;
            assert_eq!(is_left, k >= 2, "{variant:?} {k}");
            let is_proposal = object.size_m == detections[k].size_m;
            let is_refined = object.center_m == without.objects[k].center_m;
            assert!(if is_left { is_proposal } else { is_refined });
        }
    }
    // The points of the frame are gone: the refiner searches nothing and loses nothing.
    let mut out = RefinerOutput::default();
    refiner(Variant::RangeScaled).refine_within(0, &[], &detections, &mut || true, &mut out);
    assert_eq!(out.counters.unrefined, 6);
    let is_kept = |o: &Object| o.is_published() && o.flags == Object::UNREFINED;
    assert!(out.objects.iter().all(is_kept));
}

/// A wall, a plane, a blob and one spot of 131,072 points each; 512 candidates side by side or in one place. Clusters of the scan cost as much work as
/// the scan has points. Clusters grown per candidate have a limit: beyond it candidates keep their proposals, and the best scores come first.
#[test]
fn work_is_bounded_and_what_is_left_keeps_its_proposal() {
    for variant in [Variant::RangeScaled, Variant::PaperCorrected] {
        let mut refiner = refiner(variant);
        let mut any_unrefined = false;
        for (name, points) in &clouds() {
            for spread_m in [0.0, 30.0] {
                let spot = |k: u32| {
                    let aside = (f64::from(k) / 512.0 - 0.5) * spread_m;
                    let place = standing(12.0, 1.0 + aside, CART, 0.0);
                    candidate(&place, [0.0, 0.0], 1.0 + k as f32)
                };
                let detections: Vec<Detection> = (0..512).map(spot).collect();
                let mut out = RefinerOutput::default();
                refiner.refine(0, points, &detections, &mut out);
                assert_sound(points, &detections, &out);
                let (work, unrefined) = (out.counters.work, out.counters.unrefined);
                let most = match variant {
                    Variant::RangeScaled => points.len() as u64,
                    // A candidate may start when almost no work is left.
                    _ => WORK_MAX + 50 * 16_384 + 4 * points.len() as u64,
                };
                assert!(work <= most, "{name} {spread_m} {variant:?}: {work}");
                assert_eq!(unrefined > 0, work >= WORK_MAX, "{name}");
                let is_degraded = out.counters.flags().contains(Flags::DEGRADED);
                assert_eq!(is_degraded, unrefined > 0);
                let is_left = |o: &&Object| o.flags & Object::UNREFINED != 0;
                let left = out.objects.iter().filter(is_left).count();
                assert_eq!(left as u32, unrefined, "{name}");
                if unrefined > 0 {
                    any_unrefined = true;
                    assert!(!is_left(&&out.objects[0]) && is_left(&&out.objects[511]));
                    assert_eq!(out.objects[511].size_m, detections[511].size_m);
                }
            }
        }
        assert_eq!(any_unrefined, variant == Variant::PaperCorrected);
    }
}
