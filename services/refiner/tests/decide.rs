//! The scores of unknown objects: the score of their clusters, the sizes of road users, the probability of the unknown.

mod common;

use common::{assert_sound, candidate, is, known, scan, sensor, standing};
use mluc_geometry::Box3;
use mluc_ipc_types::{Detection, Disposition, Object};
use mluc_model::{CLUSTER_SCORER_VALUES, CLUSTER_SCORER_WIDTHS, ScoreMin};
use mluc_refiner::clusters::Measures;
use mluc_refiner::{
    ClusterScorer, Refiner, RefinerOutput, RobotSettings, Sensor, Settings, Study, Variant,
    cluster_scorer,
};

/// No object is dropped for its size. These are the flags of a cart, a low cart, a pole, a hut and a post.
const SIZE_FLAGS: [u32; 5] = [0, 0, Object::SMALL, Object::LARGE, Object::POST];

/// A scorer that accepts only clusters higher than about 1.4 m.
fn tall_ones() -> Option<ClusterScorer> {
    let [a, b, c, _] = CLUSTER_SCORER_WIDTHS;
    let measures = Measures { top_m: 2.0, ..Measures::default() };
    let top = cluster_scorer::features(&measures).iter().position(|f| *f == 1.0);
    let mut values = vec![0.0; CLUSTER_SCORER_VALUES];
    values[top.expect("the feature of the top") * b] = 1.0;
    let second = (a + 1) * b;
    values[second] = 1.0;
    let third = second + (b + 1) * c;
    values[third] = 40.0;
    values[CLUSTER_SCORER_VALUES - 1] = -28.0;
    ClusterScorer::new(values)
}

/// A cart, a low cart, a pole, a hut, and a post that is too high for its base area.
fn boxes() -> [Box3; 5] {
    [
        standing(10.0, 5.0, [2.6, 1.3, 1.9], 0.4),
        standing(12.0, -5.0, [2.6, 1.3, 1.0], 0.4),
        standing(7.0, 0.0, [0.25, 0.25, 1.8], 0.0),
        standing(-10.0, 0.0, [6.0, 6.0, 3.0], 0.7),
        standing(-9.0, -12.0, [0.8, 0.8, 2.4], 0.2),
    ]
}

/// A candidate on each box.
fn candidates() -> [Detection; 5] {
    boxes().map(|b| candidate(&b, [0.1, 0.1], 8.0))
}

/// The output of a refiner for the boxes and detections; it must be the same twice.
fn refined(mut refiner: Refiner, detections: &[Detection]) -> RefinerOutput {
    let points = scan(&boxes());
    let (mut once, mut again) = (RefinerOutput::default(), RefinerOutput::default());
    refiner.refine(7, &points, detections, &mut once);
    // A frame in which every point is a known object's leaves nothing behind.
    let all = known(&standing(0.0, 0.0, [80.0, 80.0, 8.0], 0.0), 0, 0.9);
    refiner.refine(8, &points, &[all], &mut again);
    refiner.refine(7, &points, detections, &mut again);
    assert_eq!(once.objects, again.objects);
    assert_sound(&points, detections, &once);
    once
}

fn run(settings: Settings, sensor: &Sensor, scorer: Option<ClusterScorer>) -> RefinerOutput {
    let refiner = Refiner::with_scorer(settings, sensor, scorer).expect("settings");
    refined(refiner, &candidates())
}

fn size_flags(out: &RefinerOutput) -> Vec<u32> {
    assert!(out.objects.iter().all(Object::is_published));
    let reasons = Object::SMALL | Object::LARGE | Object::POST;
    out.objects.iter().map(|o| o.flags & reasons).collect()
}

fn with(scores_clusters: Option<bool>, ranks_sizes: Option<bool>) -> Settings {
    Settings { study: Study { scores_clusters, ranks_sizes }, ..Settings::default() }
}

/// A model with a probability of the unknown.
fn open() -> Sensor {
    Sensor { tells_unknown: true, ..sensor() }
}

#[test]
fn what_scores_well_comes_first_and_sizes_of_no_road_user_last() {
    let plain = run(Settings::default(), &sensor(), None);
    assert_eq!(size_flags(&plain), [0; 5]);
    let scored = run(Settings::default(), &sensor(), tall_ones());
    assert_eq!(size_flags(&scored), SIZE_FLAGS);
    for (i, (scored, plain)) in scored.objects.iter().zip(&plain.objects).enumerate() {
        let share = scored.score / plain.score;
        let expected = if i == 0 { 0.99..1.01 } else { 0.0499..0.0501 };
        assert!(expected.contains(&share), "{i}: {share}");
        let place = |o: &Object| (o.center_m, o.size_m);
        assert_eq!(place(scored), place(plain));
    }
}

#[test]
fn each_can_be_had_alone_and_neither_in_the_papers_variants() {
    let plain = run(Settings::default(), &sensor(), None);
    let out = run(with(None, Some(true)), &sensor(), None);
    assert_eq!(size_flags(&out), SIZE_FLAGS);
    for (i, share) in [1.0, 1.0, 0.05, 0.05, 0.05].into_iter().enumerate() {
        assert_eq!(out.objects[i].score, plain.objects[i].score * share);
    }
    let unranked = run(with(None, Some(false)), &sensor(), tall_ones());
    assert!(unranked.objects[4].score > 0.9 * plain.objects[4].score);
    // A model with a probability of the unknown ranks sizes by itself.
    let out = run(Settings::default(), &open(), None);
    assert_eq!(size_flags(&out), SIZE_FLAGS);
    let paper = Settings::of(Variant::PaperCorrected);
    for settings in [with(Some(false), None), paper] {
        let scored = run(settings.clone(), &sensor(), tall_ones());
        assert_eq!(scored.objects, run(settings, &sensor(), None).objects);
    }
    let fault = Refiner::new(with(Some(true), None), &sensor()).expect_err("nothing is learned");
    assert!(fault.to_string().contains("clusters.looks"), "{fault}");
}

#[test]
fn the_robots_owner_decides_what_it_drives_over() {
    // The low cart is seen up to 1 m, and its top may be a gap between two beams higher.
    for (height_min_m, low_cart) in [(1.2, true), (1.05, false)] {
        let settings = Settings {
            robot: RobotSettings { height_min_m, width_min_m: 0.3 },
            ..Settings::default()
        };
        let out = run(settings, &sensor(), None);
        let found = out.objects.iter().map(|o| is(o, Disposition::Undersized));
        assert!(found.eq([false, low_cart, true, false, false]));
        let published = out.objects.iter().filter(|o| o.is_published());
        assert_eq!(published.count(), 4 - usize::from(low_cart));
    }
}

#[test]
fn what_there_was_no_time_to_score_is_published_behind_the_others() {
    let detections = candidates();
    let mut refiner =
        Refiner::with_scorer(Settings::default(), &sensor(), tall_ones()).expect("settings");
    let mut out = RefinerOutput::default();
    // First there is no time, then time for the clusters and two of the candidates.
    for (asks, unrefined) in [(0, 5), (3, 3)] {
        let mut asked = 0;
        let mut is_over = || {
            asked += 1;
            asked > asks
        };
        refiner.read_scan(&scan(&boxes()));
        refiner.refine_within(7, &scan(&boxes()), &detections, &mut is_over, &mut out);
        assert_eq!(out.counters.unrefined, unrefined);
        let objects = out.objects.iter().zip(&detections);
        for (object, detection) in objects.filter(|(o, _)| o.flags == Object::UNREFINED) {
            assert!(object.is_published() && object.size_m == detection.size_m);
            assert!(object.score < 0.051 * detection.objectness);
        }
    }
}

#[test]
fn an_open_heads_probability_ranks() {
    let mut detections = candidates();
    for (detection, p) in detections.iter_mut().zip([0.9, 0.3, f32::NAN, 0.5, 0.0]) {
        detection.unknown_probability = p;
    }
    let refiner = Refiner::new(Settings::default(), &open()).expect("settings");
    let out = refined(refiner, &detections);
    // The hut is larger than a road user: it ranks behind all others.
    for (object, expected) in out.objects.iter().zip([0.4374, 0.0162, 0.0, 0.00375, 0.0]) {
        assert!((object.score - expected).abs() < 1e-6, "{object:?}");
    }
}

#[test]
fn what_is_below_the_profiles_scores_is_not_published() {
    let mut detections = candidates().to_vec();
    for (detection, p) in detections.iter_mut().zip([0.9, 0.3, 0.9, 0.9, 0.9]) {
        detection.unknown_probability = p;
    }
    for (x_m, score) in [(20.0, 0.4), (30.0, 0.5)] {
        let car = standing(x_m, 0.0, [4.0, 1.7, 1.5], 0.0);
        detections.push(known(&car, 0, score));
    }
    let mut refiner = Refiner::new(Settings::default(), &open()).expect("settings");
    let least = ScoreMin { known: 0.5, unknown: 0.3, both_readings: false };
    refiner.set_score_min(least);
    let out = refined(refiner, &detections);
    let low = out.objects.iter().map(|o| is(o, Disposition::LowScore));
    assert!(low.eq([false, true, true, true, true, true, false]));
    let published = out.objects.iter().filter(|o| o.is_published());
    assert_eq!(published.count(), 2);
}

#[test]
fn a_doubted_known_object_suppresses_nothing_and_gives_way() {
    use Disposition::{LowScore, OverlapsKnown, OverlapsUnknown, Published};
    let own = candidates()[0];
    for (p, least_known, unknown, expected) in [
        (0.1, 0.0, 0.1, [Published, OverlapsKnown]),
        // What the profile withholds suppresses nothing.
        (0.1, 0.9, 0.1, [LowScore, Published]),
        (0.4, 0.0, 0.1, [OverlapsUnknown, Published]),
        (0.4, 0.0, 0.9, [Published, LowScore]),
        (0.4, 0.0, 0.0, [Published, Published]),
    ] {
        let mut doubted = known(&boxes()[0], 0, 0.8);
        doubted.unknown_probability = p;
        let mut refiner = Refiner::new(Settings::default(), &open()).expect("settings");
        refiner.set_score_min(ScoreMin { known: least_known, unknown, ..ScoreMin::default() });
        let mut generic = own;
        generic.unknown_probability = 0.7;
        let out = refined(refiner, &[doubted, generic]);
        let found = [&out.objects[0], &out.objects[1]].map(|object| object.disposition);
        assert_eq!(found, expected.map(|one| one as u32), "{p} {unknown}");
    }
}

#[test]
fn a_doubted_box_is_published_once_or_as_all_that_it_may_be() {
    // Carts with a class, sure enough to be unknown or not, and one whose points are a car's; a pole of an anchor without a class.
    let mut detections = candidates().to_vec();
    let told = [(0.9, 0.9), (0.3, 0.6), (0.9, 0.6), (0.9, 0.4)];
    for (detection, (p, score)) in detections.iter_mut().zip(told) {
        (detection.unknown_probability, detection.score) = (p, score);
        detection.probabilities[0] = score;
    }
    detections[2].probabilities[0] = 0.0;
    detections.truncate(4);
    let with = |score_min| {
        let mut refiner = Refiner::new(Settings::default(), &open()).expect("settings");
        refiner.set_score_min(score_min);
        refined(refiner, &detections)
    };
    let (known, unknown) = (0.5, 0.3);
    let all = with(ScoreMin { both_readings: true, ..ScoreMin::default() });
    assert!(all.objects.len() == 7 && all.objects.iter().all(Object::is_published));
    let mut out = with(ScoreMin { known, unknown, both_readings: false });
    let seconds = |out: &RefinerOutput| out.objects[4..].to_vec();
    let [cart, low_cart, hut] = seconds(&out).try_into().expect("three");
    assert!(is(&cart, Disposition::OverlapsUnknown) && cart.suppressed_by == 0);
    assert!(low_cart.is_published() && low_cart.size_m == detections[1].size_m);
    assert!(is(&hut, Disposition::LowScore));
    // An object that a track does not confirm, or without a cluster, is known again; so is one in a better one with a low score (the hut).
    // An object that a known object covers is neither known nor unknown.
    out.objects[0].suppressed_by = 3;
    assert!(is(&out.objects[3], Disposition::LowScore));
    for (reason, expected) in [
        (Disposition::Unconfirmed, Disposition::Published),
        (Disposition::TooFewPoints, Disposition::Published),
        (Disposition::OverlapsUnknown, Disposition::Published),
        (Disposition::OverlapsKnown, Disposition::OverlapsKnown),
    ] {
        out.objects[0].disposition = reason as u32;
        out.objects[4].disposition = Disposition::Published as u32;
        out.choose_readings();
        assert!(is(&out.objects[4], expected), "{reason:?}");
    }
}
