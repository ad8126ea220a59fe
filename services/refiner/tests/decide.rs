//! What unknown objects are worth: the score of their clusters, the sizes of road users, the probability of the unknown.

mod common;

use common::{candidate, scan, sensor, standing};
use mluc_ipc_types::{Detection, Disposition, Object};
use mluc_model::{LOOKS_VALUES, LOOKS_WIDTHS};
use mluc_refiner::{
    ClusterScorer, Refiner, RefinerError, RefinerOutput, RobotSettings, Sensor, Settings, Study,
    Variant, cluster_scorer,
};

/// Nothing goes for its size; this is said of a cart, a low cart, a post and a hut.
const SIZE_FLAGS: [u32; 4] = [0, 0, Object::SMALL, Object::LARGE];

/// Only what is higher than about 1.4 m looks like something.
fn tall_ones() -> ClusterScorer {
    let [a, b, c, _] = LOOKS_WIDTHS;
    let measures = mluc_refiner::clusters::Measures {
        top_m: 2.0,
        ..Default::default()
    };
    let top = cluster_scorer::features(&measures)
        .iter()
        .position(|f| *f == 1.0);
    let mut values = vec![0.0; LOOKS_VALUES];
    values[top.expect("the feature of the top") * b] = 1.0;
    let second = (a + 1) * b;
    values[second] = 1.0;
    let third = second + (b + 1) * c;
    values[third] = 40.0;
    values[LOOKS_VALUES - 1] = -28.0;
    ClusterScorer::new(values).expect("as many as there must be")
}

/// A cart, a low cart, a post and a hut, and a candidate on each.
fn scene() -> (Vec<mluc_ipc_types::Point>, Vec<Detection>) {
    let boxes = [
        standing(10.0, 5.0, [2.6, 1.3, 1.9], 0.4),
        standing(12.0, -5.0, [2.6, 1.3, 1.0], 0.4),
        standing(7.0, 0.0, [0.25, 0.25, 1.8], 0.0),
        standing(-10.0, 0.0, [6.0, 6.0, 3.0], 0.7),
    ];
    let candidates = boxes.iter().map(|b| candidate(b, [0.1, 0.1], 8.0));
    (scan(&boxes), candidates.collect())
}

fn run(settings: Settings, sensor: &Sensor, scorer: Option<ClusterScorer>) -> RefinerOutput {
    let (points, detections) = scene();
    let mut refiner = Refiner::with_scorer(settings, sensor, scorer).expect("settings");
    let (mut once, mut again) = (RefinerOutput::default(), RefinerOutput::default());
    refiner.refine(7, &points, &detections, &mut once);
    refiner.refine(7, &points, &detections, &mut again);
    assert_eq!(once.objects, again.objects);
    common::assert_sound(&points, &detections, &once, "scores");
    once
}

fn size_flags(out: &RefinerOutput) -> Vec<u32> {
    assert!(out.objects.iter().all(Object::is_published));
    let reasons = Object::SMALL | Object::LARGE | Object::POST;
    out.objects.iter().map(|o| o.flags & reasons).collect()
}

fn with(study: Study) -> Settings {
    Settings {
        study,
        ..Settings::default()
    }
}

#[test]
fn what_scores_well_comes_first_and_sizes_of_no_road_user_last() {
    let plain = run(Settings::default(), &sensor(), None);
    assert_eq!(size_flags(&plain), [0; 4]);
    let scored = run(Settings::default(), &sensor(), Some(tall_ones()));
    assert_eq!(size_flags(&scored), SIZE_FLAGS);
    let share = |i: usize| scored.objects[i].score / plain.objects[i].score;
    assert!(share(0) > 0.99, "{}", share(0));
    for i in 1..4 {
        assert!((share(i) - 0.05).abs() < 1e-6, "{i}: {}", share(i));
    }
    for (scored, plain) in scored.objects.iter().zip(&plain.objects) {
        assert_eq!(
            (scored.center_m, scored.size_m),
            (plain.center_m, plain.size_m)
        );
    }
}

#[test]
fn each_can_be_had_alone_and_neither_in_the_papers_variants() {
    let sized = with(Study {
        ranks_sizes: Some(true),
        ..Study::default()
    });
    let out = run(sized, &sensor(), None);
    assert_eq!(size_flags(&out), SIZE_FLAGS);
    let plain = run(Settings::default(), &sensor(), None);
    assert_eq!(out.objects[1].score, plain.objects[1].score);
    assert_eq!(out.objects[3].score, plain.objects[3].score * 0.05);
    // A model with a probability of the unknown ranks sizes by itself.
    let open = Sensor {
        tells_unknown: true,
        ..sensor()
    };
    let out = run(Settings::default(), &open, None);
    assert_eq!(size_flags(&out), SIZE_FLAGS);
    for settings in [
        with(Study {
            scores_clusters: Some(false),
            ..Study::default()
        }),
        Settings {
            variant: Variant::PaperCorrected,
            ..Settings::default()
        },
    ] {
        let scored = run(settings.clone(), &sensor(), Some(tall_ones()));
        assert_eq!(scored.objects, run(settings, &sensor(), None).objects);
    }
    let wanted = with(Study {
        scores_clusters: Some(true),
        ..Study::default()
    });
    let fault = Refiner::new(wanted, &sensor()).expect_err("nothing is learned");
    assert!(
        matches!(fault, RefinerError::NoClusterScorer { .. }),
        "{fault}"
    );
    assert!(fault.to_string().contains("clusters.looks"), "{fault}");
}

#[test]
fn the_robots_owner_decides_what_it_drives_over() {
    let robot = RobotSettings {
        height_min_m: 1.2,
        width_min_m: 0.3,
    };
    let settings = Settings {
        robot,
        ..Settings::default()
    };
    let out = run(settings, &sensor(), None);
    let expected = [
        Disposition::Published,
        Disposition::Undersized,
        Disposition::Undersized,
        Disposition::Published,
    ];
    let found = out.objects.iter().map(|o| o.disposition);
    assert!(
        found.eq(expected.map(|d| d as u32)),
        "{:?}",
        out.counters.by_disposition
    );
}

#[test]
fn a_thing_too_high_for_its_ground_stays_behind_all_others() {
    let boxes = [
        standing(10.0, 5.0, [2.6, 1.3, 1.9], 0.4),
        standing(9.0, -4.0, [0.8, 0.8, 2.4], 0.2),
    ];
    let candidates: Vec<Detection> = boxes
        .iter()
        .map(|b| candidate(b, [0.1, 0.1], 8.0))
        .collect();
    let points = scan(&boxes);
    let objects = |ranks_sizes: bool, scorer: Option<ClusterScorer>| {
        let settings = with(Study {
            ranks_sizes: Some(ranks_sizes),
            ..Study::default()
        });
        let mut refiner = Refiner::with_scorer(settings, &sensor(), scorer).expect("settings");
        let mut out = RefinerOutput::default();
        refiner.refine(7, &points, &candidates, &mut out);
        assert!(out.objects.iter().all(Object::is_published));
        out.objects
    };
    let plain = objects(false, None);
    let sized = objects(true, None);
    assert_eq!(sized[0].score, plain[0].score);
    assert_eq!(sized[1].score, plain[1].score * 0.05);
    assert_eq!([sized[0].flags, sized[1].flags], [0, Object::POST]);
    let scored = objects(true, Some(tall_ones()));
    assert!(scored[0].score > 0.99 * plain[0].score && scored[1].score <= 0.051 * plain[1].score);
    assert!(objects(false, Some(tall_ones()))[1].score > 0.9 * plain[1].score);
}

#[test]
fn what_there_was_no_time_to_score_is_published_flagged() {
    let (points, detections) = scene();
    let mut refiner =
        Refiner::with_scorer(Settings::default(), &sensor(), Some(tall_ones())).expect("settings");
    let mut out = RefinerOutput::default();
    refiner.refine_within(7, &points, &detections, &mut || true, &mut out);
    for (object, detection) in out.objects.iter().zip(&detections) {
        assert!(object.is_published() && object.flags == Object::UNREFINED);
        assert_eq!(object.size_m, detection.size_m);
    }
    assert_eq!(out.counters.unrefined, 4);
    // Time for the clusters and two of the candidates: the proposals of the others are ranked behind them.
    let mut asked = 0;
    let mut is_over = || {
        asked += 1;
        asked > 3
    };
    refiner.refine_within(7, &points, &detections, &mut is_over, &mut out);
    assert_eq!(out.counters.unrefined, 2);
    let unrefined = out.objects.iter().filter(|o| o.flags == Object::UNREFINED);
    for object in unrefined {
        assert!(object.is_published() && object.score < detections[0].objectness);
    }
}

#[test]
fn an_open_heads_probability_ranks() {
    let open = Sensor {
        tells_unknown: true,
        ..sensor()
    };
    let (points, mut detections) = scene();
    for (detection, p) in detections.iter_mut().zip([0.9, 0.3, f32::NAN, 0.5]) {
        detection.unknown_probability = p;
    }
    let mut refiner = Refiner::new(Settings::default(), &open).expect("settings");
    let mut out = RefinerOutput::default();
    refiner.refine(7, &points, &detections, &mut out);
    let expected = [0.9f32, 0.3].map(|p| 0.6 * p);
    assert_eq!([0, 1].map(|i: usize| out.objects[i].score), expected);
    assert_eq!(out.objects[2].score, 0.0);
    // Larger than a road user: behind all others.
    assert!((out.objects[3].score - 0.05 * 0.3).abs() < 1e-6);
}
