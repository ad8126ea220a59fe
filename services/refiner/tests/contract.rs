//! One suite that every refiner passes, whatever comes in.

mod common;

use common::{assert_sound, box_of, candidate, known, point, refine, refiner, scan, standing};
use mluc_geometry::Box3;
use mluc_ipc_types::{Detection, Disposition, Flags, Object, Point};
use mluc_refiner::{RefinerOutput, Variant, WORK_MAX};

const CART: [f64; 3] = [2.6, 1.25, 1.85];

fn one_candidate() -> Vec<Detection> {
    vec![candidate(&standing(12.0, 1.0, CART, 0.0), [0.5, -0.3], 1.0)]
}

fn check_all(
    points: &[Point],
    detections: &[Detection],
    what: &str,
) -> Vec<(Variant, RefinerOutput)> {
    Variant::ALL
        .into_iter()
        .map(|variant| {
            let out = refine(variant, points, detections);
            assert_sound(
                points,
                detections,
                &out,
                &format!("{what}, {}", variant.name()),
            );
            (variant, out)
        })
        .collect()
}

#[test]
fn an_empty_frame_and_no_candidates() {
    for (variant, out) in check_all(&[], &one_candidate(), "no points") {
        let expected = match variant {
            Variant::None => Disposition::Published,
            _ => Disposition::TooFewPoints,
        };
        assert_eq!(out.objects[0].disposition, expected as u32, "{variant:?}");
    }
    check_all(&scan(&[]), &[], "no candidates");
    check_all(&[], &[], "nothing");
}

#[test]
fn five_hundred_and_twelve_candidates_on_one_spot() {
    let cart = standing(12.0, 1.0, CART, 0.3);
    let points = scan(&[cart]);
    let detections: Vec<Detection> = (0..600)
        .map(|k| candidate(&cart, [0.001 * f64::from(k), 0.0], 1.0 + k as f32))
        .collect();
    for (variant, out) in check_all(&points, &detections, "512 candidates") {
        assert_eq!(out.counters.detections_dropped, 88);
        assert!(out.counters.flags().contains(Flags::LIMIT_DETECTIONS));
        if matches!(variant, Variant::PaperCorrected | Variant::RangeScaled) {
            assert_eq!(
                out.objects[0].disposition,
                Disposition::Published as u32,
                "the best one stays"
            );
            let overlapping = out.counters.with_disposition(Disposition::OverlapsUnknown);
            assert!(overlapping >= 500, "{variant:?}: {overlapping}");
        }
    }
}

/// Clouds that are no scene, 131,072 points each.
fn clouds() -> [(&'static str, Vec<Point>); 5] {
    const COUNT: usize = 131_072;
    let share = |i: usize, k: f64| (i as f64 * k).fract() - 0.5;
    [
        ("all equal", vec![point([12.0, 1.0, -1.0]); COUNT]),
        (
            "on a line",
            (0..COUNT)
                .map(|i| point([i as f64 * 1e-3 - 60.0, 1.0, -0.5]))
                .collect(),
        ),
        (
            "one wall",
            (0..COUNT)
                .map(|i| point([12.0, 60.0 * share(i, 0.618_034), 4.0 * share(i, 0.414_214)]))
                .collect(),
        ),
        (
            "one plane",
            (0..COUNT)
                .map(|i| {
                    point([
                        60.0 * share(i, 0.618_034),
                        60.0 * share(i, 0.414_214),
                        -1.73,
                    ])
                })
                .collect(),
        ),
        (
            "one blob",
            (0..COUNT)
                .map(|i| {
                    point([
                        12.0 + 3.0 * share(i, 0.618_034),
                        1.0 + 3.0 * share(i, 0.414_214),
                        -0.5 + 2.0 * share(i, 0.732_051),
                    ])
                })
                .collect(),
        ),
    ]
}

#[test]
fn clouds_that_are_no_scene() {
    let detections: Vec<Detection> = (0..20)
        .flat_map(|k| {
            let place = standing(12.0, 1.0 + 0.1 * f64::from(k), CART, 0.0);
            [candidate(&place, [0.0, 0.0], 1.0), known(&place, 0, 0.9)]
        })
        .collect();
    for (name, points) in &clouds() {
        for (variant, out) in check_all(points, &detections, name) {
            for object in out.objects.iter().filter(|o| o.is_published()) {
                holds_its_points(points, &out, object, &format!("{name}, {variant:?}"));
            }
        }
    }
}

/// No join of what lies apart: an object's points lie in its box, and within reach of each other.
fn holds_its_points(points: &[Point], out: &RefinerOutput, object: &Object, what: &str) {
    const NOISE_M: f64 = 0.05;
    const REACH_M: f64 = 10.0;
    let own = out.points_of(object);
    let shape = box_of(object);
    let grown = Box3 {
        size_m: shape.size_m.map(|side| side + 2.0 * NOISE_M),
        ..shape
    };
    for &index in own {
        let p = points[index as usize];
        let at = [p.x_m, p.y_m, p.z_m].map(f64::from);
        assert!(grown.contains(at), "{what}: {at:?} outside of {shape:?}");
        let off = (at[0] - shape.center_m[0]).hypot(at[1] - shape.center_m[1]);
        assert!(off < REACH_M, "{what}: {at:?} in {shape:?}");
    }
}

#[test]
fn points_that_are_not_finite_are_left_out_and_counted() {
    let cart = standing(12.0, 1.0, CART, 0.3);
    let clean = scan(&[cart]);
    let mut points = clean.clone();
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        points.extend([
            point([bad, 1.0, -1.0]),
            point([12.0, bad, -1.0]),
            point([12.0, 1.0, bad]),
        ]);
    }
    let detections = [candidate(&cart, [0.4, 0.2], 1.0)];
    for (variant, out) in check_all(&points, &detections, "not finite") {
        assert_eq!(out.counters.points_not_finite, 9, "{variant:?}");
        let without = refine(variant, &clean, &detections);
        assert_eq!(out.objects, without.objects, "{variant:?}");
    }
}

#[test]
fn detections_that_make_no_sense_are_told() {
    let cart = standing(12.0, 1.0, CART, 0.3);
    let points = scan(&[cart]);
    let sound = candidate(&cart, [0.4, 0.2], 1.0);
    let mut detections = vec![sound];
    for bad in [0.0, -1.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for axis in 0..3 {
            let mut broken = sound;
            broken.size_m[axis] = bad;
            detections.push(broken);
            let mut lost = known(&cart, 0, 0.9);
            lost.size_m[axis] = bad;
            detections.push(lost);
        }
    }
    for place in [f32::NAN, f32::INFINITY, f32::MAX] {
        let mut lost = sound;
        lost.center_m[1] = place;
        detections.push(lost);
    }
    detections.push(Detection { kind: 9, ..sound });
    detections.push(Detection {
        class_id: 77,
        ..sound
    });
    detections.push(Detection {
        yaw_rad: f32::NAN,
        ..sound
    });
    for (variant, out) in check_all(&points, &detections, "nonsense") {
        assert_eq!(
            out.counters.invalid_detections as usize,
            detections.len() - 1,
            "{variant:?}"
        );
        assert!(out.counters.flags().contains(Flags::DEGRADED));
        assert_eq!(
            out.objects[0].disposition,
            Disposition::Published as u32,
            "{variant:?}"
        );
        assert!(
            out.objects[1..]
                .iter()
                .all(|o| o.disposition == Disposition::InvalidBox as u32)
        );
    }
}

#[test]
fn candidates_far_away_or_of_any_size_are_told() {
    let cart = standing(12.0, 1.0, CART, 0.3);
    let points = scan(&[cart]);
    let far = standing(5000.0, 1.0, CART, 0.0);
    let mut huge = candidate(&cart, [0.0, 0.0], 1.0);
    huge.size_m = [9000.0; 3];
    let mut tiny = candidate(&cart, [0.0, 0.0], 2.0);
    tiny.size_m = [1e-30; 3];
    let mut worthless = candidate(&cart, [0.0, 0.0], 0.0);
    worthless.eds_normalised = f32::NAN;
    let detections = [candidate(&far, [0.0, 0.0], 1.0), huge, tiny, worthless];
    for (variant, out) in check_all(&points, &detections, "far") {
        if variant != Variant::None {
            assert_eq!(
                out.objects[0].disposition,
                Disposition::TooFewPoints as u32,
                "{variant:?}"
            );
        }
        assert_eq!(out.objects[3].score, 0.0);
    }
}

#[test]
fn when_the_time_is_up_the_worst_candidates_keep_their_proposals() {
    let carts: Vec<_> = (0..6)
        .map(|k| {
            standing(
                9.0 + 4.0 * f64::from(k),
                6.0 - 2.5 * f64::from(k),
                CART,
                0.4,
            )
        })
        .collect();
    let points = scan(&carts);
    let detections: Vec<Detection> = carts
        .iter()
        .enumerate()
        .map(|(k, cart)| candidate(cart, [0.3, -0.3], 1.0 + k as f32))
        .collect();
    for variant in [Variant::PaperCorrected, Variant::RangeScaled] {
        let mut out = RefinerOutput::default();
        let mut asked = 0;
        let mut is_over = || {
            asked += 1;
            // Once for the clusters, then for each candidate.
            asked > 3
        };
        refiner(variant).refine_within(0, &points, &detections, &mut is_over, &mut out);
        assert_sound(&points, &detections, &out, variant.name());
        assert_eq!(out.counters.unrefined, 4, "{variant:?}");
        let without = refine(variant, &points, &detections);
        for (k, object) in out.objects.iter().enumerate() {
            let is_refined = k < 2;
            assert_eq!(
                object.flags & Object::UNREFINED == 0,
                is_refined,
                "{variant:?} {k}"
            );
            if is_refined {
                assert_eq!(object.center_m, without.objects[k].center_m);
            } else {
                assert_eq!(object.size_m, detections[k].size_m);
            }
        }
    }
    // A frame whose points are gone: nothing is looked for, nothing is lost.
    let mut out = RefinerOutput::default();
    refiner(Variant::RangeScaled).refine_within(0, &[], &detections, &mut || true, &mut out);
    assert_eq!(out.counters.unrefined, 6);
    assert!(
        out.objects
            .iter()
            .all(|o| o.is_published() && o.flags == Object::UNREFINED)
    );
}

/// A wall, a plane, a blob and one spot of 131,072 points each; 512 candidates beside each other and all in one place.
/// Clusters of the scan cost what its points cost; grown for each candidate, what is left beyond the limit keeps its
/// proposal, the best scores first.
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
                assert_sound(points, &detections, &out, name);
                let (work, unrefined) = (out.counters.work, out.counters.unrefined);
                // One candidate may be begun with hardly any work left.
                let most = match variant {
                    Variant::RangeScaled => points.len() as u64,
                    _ => WORK_MAX + 50 * 16_384 + 4 * points.len() as u64,
                };
                assert!(work <= most, "{name} {spread_m} {variant:?}: {work}");
                assert_eq!(unrefined > 0, work >= WORK_MAX, "{name}");
                let is_degraded = out.counters.flags().contains(Flags::DEGRADED);
                assert_eq!(is_degraded, unrefined > 0);
                let is_left = |o: &Object| o.flags & Object::UNREFINED != 0;
                let left = out.objects.iter().filter(|o| is_left(o));
                assert_eq!(left.count() as u32, unrefined, "{name}");
                if unrefined > 0 {
                    any_unrefined = true;
                    assert!(!is_left(&out.objects[0]) && is_left(&out.objects[511]));
                    assert_eq!(out.objects[511].size_m, detections[511].size_m);
                }
            }
        }
        assert_eq!(any_unrefined, variant == Variant::PaperCorrected);
    }
}

#[test]
fn the_same_bits_with_one_and_two_threads_and_on_a_second_run() {
    let carts: Vec<_> = (0..6)
        .map(|k| {
            standing(
                9.0 + 3.0 * f64::from(k),
                6.0 - 2.5 * f64::from(k),
                CART,
                0.4,
            )
        })
        .collect();
    let points = scan(&carts);
    let detections: Vec<Detection> = carts
        .iter()
        .map(|cart| candidate(cart, [0.4, -0.6], 2.0))
        .collect();
    for variant in Variant::ALL {
        let mut used = refiner(variant);
        let mut run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .expect("pool");
            let mut out = RefinerOutput::default();
            pool.install(|| used.refine(3, &points, &detections, &mut out));
            (out.objects, out.object_points)
        };
        let first = run(1);
        assert_eq!(first, run(2), "{variant:?}");
        assert_eq!(first, run(1), "{variant:?}");
    }
}
