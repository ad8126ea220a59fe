//! One suite that every refiner passes, whatever comes in.

mod common;

use common::{assert_sound, box_of, candidate, known, point, refine, refiner, scan, standing};
use mluc_geometry::Box3;
use mluc_ipc_types::{Detection, Fate, Object, Point};
use mluc_refiner::{Mode, Refined};

const CART: [f64; 3] = [2.6, 1.25, 1.85];

fn one_candidate() -> Vec<Detection> {
    vec![candidate(&standing(12.0, 1.0, CART, 0.0), [0.5, -0.3], 1.0)]
}

fn check_all(points: &[Point], detections: &[Detection], what: &str) -> Vec<(Mode, Refined)> {
    Mode::ALL
        .into_iter()
        .map(|mode| {
            let out = refine(mode, points, detections);
            assert_sound(
                points,
                detections,
                &out,
                &format!("{what}, {}", mode.name()),
            );
            (mode, out)
        })
        .collect()
}

#[test]
fn an_empty_frame_and_no_candidates() {
    for (mode, out) in check_all(&[], &one_candidate(), "no points") {
        let expected = match mode {
            Mode::None => Fate::Published,
            _ => Fate::TooFewPoints,
        };
        assert_eq!(out.objects[0].fate, expected as u32, "{mode:?}");
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
    for (mode, out) in check_all(&points, &detections, "512 candidates") {
        assert_eq!(out.counters.detections_dropped, 88);
        assert!(out.counters.limit_hit());
        if matches!(mode, Mode::Corrected | Mode::Distance) {
            assert_eq!(
                out.objects[0].fate,
                Fate::Published as u32,
                "the best one stays"
            );
            let overlapping = out.counters.with_fate(Fate::OverlapsUnknown);
            assert!(overlapping >= 500, "{mode:?}: {overlapping}");
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
        for (mode, out) in check_all(points, &detections, name) {
            for object in out.objects.iter().filter(|o| o.is_published()) {
                holds_its_points(points, &out, object, &format!("{name}, {mode:?}"));
            }
        }
    }
}

/// No join of what lies apart: an object's points lie in its box, and within reach of each other.
fn holds_its_points(points: &[Point], out: &Refined, object: &Object, what: &str) {
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
    for (mode, out) in check_all(&points, &detections, "not finite") {
        assert_eq!(out.counters.points_not_finite, 9, "{mode:?}");
        let without = refine(mode, &clean, &detections);
        assert_eq!(out.objects, without.objects, "{mode:?}");
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
    for (mode, out) in check_all(&points, &detections, "nonsense") {
        assert_eq!(
            out.counters.invalid_detections as usize,
            detections.len() - 1,
            "{mode:?}"
        );
        assert!(out.counters.degraded());
        assert_eq!(out.objects[0].fate, Fate::Published as u32, "{mode:?}");
        assert!(
            out.objects[1..]
                .iter()
                .all(|o| o.fate == Fate::InvalidBox as u32)
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
    for (mode, out) in check_all(&points, &detections, "far") {
        if mode != Mode::None {
            assert_eq!(out.objects[0].fate, Fate::TooFewPoints as u32, "{mode:?}");
        }
        assert_eq!(out.objects[3].score, 0.0);
    }
}

#[test]
fn work_is_bounded_and_what_is_left_keeps_its_proposal() {
    let cart = standing(12.0, 1.0, CART, 0.3);
    let points = scan(&[cart]);
    let settings = mluc_refiner::Settings {
        mode: Mode::Distance,
        work_max: 1,
        ..mluc_refiner::Settings::default()
    };
    let mut refiner = mluc_refiner::Refiner::new(settings, &common::sensor()).expect("settings");
    let second = standing(20.0, -6.0, CART, 0.0);
    let detections = [
        candidate(&second, [0.0, 0.0], 9.0),
        candidate(&cart, [0.4, 0.2], 1.0),
    ];
    let mut out = Refined::default();
    refiner.refine(0, &points, &detections, &mut out);
    assert_eq!(out.counters.unrefined, 1);
    assert!(out.counters.limit_hit() && out.counters.degraded());
    // The better score went first, though it came second.
    assert!(out.objects[1].points_count > 0);
    assert_eq!(out.objects[0].size_m, detections[0].size_m);
    assert_eq!(out.objects[0].fate, Fate::Published as u32);
    assert_eq!(out.objects[0].flags, Object::UNREFINED);
    assert_eq!(out.objects[1].flags, 0);
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
    for mode in [
        Mode::Corrected,
        Mode::Distance,
        Mode::Euclidean,
        Mode::Dbscan,
    ] {
        let mut out = Refined::default();
        let mut asked = 0;
        let mut is_over = || {
            asked += 1;
            asked > 2
        };
        refiner(mode).refine_within(0, &points, &detections, &mut is_over, &mut out);
        assert_sound(&points, &detections, &out, mode.name());
        assert_eq!(out.counters.unrefined, 4, "{mode:?}");
        let without = refine(mode, &points, &detections);
        for (k, object) in out.objects.iter().enumerate() {
            let is_refined = k < 2;
            assert_eq!(
                object.flags & Object::UNREFINED == 0,
                is_refined,
                "{mode:?} {k}"
            );
            match is_refined {
                true => assert_eq!(object.center_m, without.objects[k].center_m),
                false => assert_eq!(object.size_m, detections[k].size_m),
            }
        }
    }
    // A frame whose points are gone: nothing is looked for, nothing is lost.
    let mut out = Refined::default();
    refiner(Mode::Distance).refine_within(0, &[], &detections, &mut || true, &mut out);
    assert_eq!(out.counters.unrefined, 6);
    assert!(
        out.objects
            .iter()
            .all(|o| o.is_published() && o.flags == Object::UNREFINED)
    );
}

/// A wall, a plane, a blob and one spot of 131,072 points each; 512 candidates beside each other and all in one place.
#[test]
fn frames_made_to_be_dear_stay_within_the_work_and_are_flagged() {
    let settings = mluc_refiner::Settings {
        mode: Mode::Distance,
        ..mluc_refiner::Settings::default()
    };
    let work_max = settings.work_max;
    // One candidate may be begun with hardly any work left: thinned points, some fifty times.
    let work_of_one = 50 * u64::from(settings.points_per_candidate_max) + 4 * 131_072;
    let mut refiner = mluc_refiner::Refiner::new(settings, &common::sensor()).expect("settings");
    let mut any_unrefined = false;
    for (name, points) in &clouds() {
        for spread_m in [0.0, 30.0] {
            let detections: Vec<Detection> = (0..512)
                .map(|k| {
                    let aside = (f64::from(k) / 512.0 - 0.5) * spread_m;
                    candidate(
                        &standing(12.0, 1.0 + aside, CART, 0.0),
                        [0.0, 0.0],
                        1.0 + k as f32,
                    )
                })
                .collect();
            let mut out = Refined::default();
            refiner.refine(0, points, &detections, &mut out);
            assert_sound(points, &detections, &out, name);
            let work = out.counters.work;
            assert!(work <= work_max + work_of_one, "{name} {spread_m}: {work}");
            let flagged = out
                .objects
                .iter()
                .filter(|o| o.flags & Object::UNREFINED != 0);
            assert_eq!(flagged.count() as u32, out.counters.unrefined, "{name}");
            assert_eq!(
                out.counters.unrefined > 0,
                out.counters.work >= work_max,
                "{name}"
            );
            any_unrefined |= out.counters.unrefined > 0;
        }
    }
    assert!(any_unrefined, "no frame was dear enough");
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
    for mode in Mode::ALL {
        let mut used = refiner(mode);
        let mut run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .expect("pool");
            let mut out = Refined::default();
            pool.install(|| used.refine(3, &points, &detections, &mut out));
            (out.objects, out.object_points)
        };
        let first = run(1);
        assert_eq!(first, run(2), "{mode:?}");
        assert_eq!(first, run(1), "{mode:?}");
    }
}
