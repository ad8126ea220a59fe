//! What unknown objects are worth: the looks of their clusters, the sizes of road users, the logit of the unknown.

mod common;

use common::{candidate, scan, sensor, standing};
use mluc_ipc_types::{Detection, Fate, Object};
use mluc_model::{LOOKS_VALUES, LOOKS_WIDTHS};
use mluc_refiner::{
    HullSettings, Looks, Mode, Refined, Refiner, RefinerError, Sensor, Settings, looks,
};

/// Fates where objects are held to the sizes of road users: what is larger stays.
const SIZED: [Fate; 4] = [
    Fate::Published,
    Fate::Published,
    Fate::Undersized,
    Fate::Published,
];

/// Only what is higher than about 1.4 m looks like something.
fn tall_ones() -> Looks {
    let [a, b, c, _] = LOOKS_WIDTHS;
    let measures = mluc_refiner::everything::Measures {
        top_m: 2.0,
        ..Default::default()
    };
    let top = looks::features(&measures).iter().position(|f| *f == 1.0);
    let mut values = vec![0.0; LOOKS_VALUES];
    values[top.expect("the feature of the top") * b] = 1.0;
    let second = (a + 1) * b;
    values[second] = 1.0;
    let third = second + (b + 1) * c;
    values[third] = 40.0;
    values[LOOKS_VALUES - 1] = -28.0;
    Looks::new(values).expect("as many as there must be")
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

fn run(settings: Settings, sensor: &Sensor, looks: Option<Looks>) -> Refined {
    let (points, detections) = scene();
    let mut refiner = Refiner::with_looks(settings, sensor, looks).expect("settings");
    let (mut once, mut again) = (Refined::default(), Refined::default());
    refiner.refine(7, &points, &detections, &mut once);
    refiner.refine(7, &points, &detections, &mut again);
    assert_eq!(once.objects, again.objects);
    common::assert_sound(&points, &detections, &once, "looks");
    once
}

fn fates(out: &Refined) -> Vec<Fate> {
    let fate = |o: &Object| Fate::ALL[o.fate as usize];
    out.objects.iter().map(fate).collect()
}

#[test]
fn what_looks_like_something_comes_first_and_huts_and_posts_go() {
    let plain = run(Settings::default(), &sensor(), None);
    assert_eq!(fates(&plain), [Fate::Published; 4]);
    let judged = run(Settings::default(), &sensor(), Some(tall_ones()));
    assert_eq!(fates(&judged), SIZED);
    let share = |i: usize| judged.objects[i].score / plain.objects[i].score;
    assert!(share(0) > 0.99, "{}", share(0));
    for i in [1, 3] {
        assert!((share(i) - 0.05).abs() < 1e-6, "{i}: {}", share(i));
    }
    for (judged, plain) in judged.objects.iter().zip(&plain.objects) {
        assert_eq!(
            (judged.center_m, judged.size_m),
            (plain.center_m, plain.size_m)
        );
    }
}

#[test]
fn each_can_be_had_alone_and_neither_in_the_papers_modes() {
    let sized = Settings {
        hull: HullSettings {
            applies: Some(true),
            ..HullSettings::default()
        },
        ..Settings::default()
    };
    let out = run(sized, &sensor(), None);
    assert_eq!(fates(&out), SIZED);
    let plain = run(Settings::default(), &sensor(), None);
    assert_eq!(out.objects[1].score, plain.objects[1].score);
    assert_eq!(out.objects[3].score, plain.objects[3].score * 0.05);
    // A model with a logit of the unknown asks for the size by itself.
    let open = Sensor {
        unknown_logit_at: Some(1),
        ..sensor()
    };
    let out = run(Settings::default(), &open, None);
    assert_eq!(fates(&out), SIZED);
    for settings in [
        Settings {
            looks: Some(false),
            ..Settings::default()
        },
        Settings {
            mode: Mode::Corrected,
            ..Settings::default()
        },
    ] {
        let with = run(settings.clone(), &sensor(), Some(tall_ones()));
        assert_eq!(with.objects, run(settings, &sensor(), None).objects);
    }
    let wanted = Settings {
        looks: Some(true),
        ..Settings::default()
    };
    let fault = Refiner::new(wanted, &sensor()).expect_err("nothing is learned");
    assert!(matches!(fault, RefinerError::NoLooks { .. }), "{fault}");
    assert!(fault.to_string().contains("clusters.looks"), "{fault}");
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
    let scores = |hull: HullSettings, looks: Option<Looks>| {
        let settings = Settings {
            hull,
            ..Settings::default()
        };
        let mut refiner = Refiner::with_looks(settings, &sensor(), looks).expect("settings");
        let mut out = Refined::default();
        refiner.refine(7, &points, &candidates, &mut out);
        assert_eq!(fates(&out), [Fate::Published; 2]);
        [0, 1].map(|i: usize| out.objects[i].score)
    };
    let sized = HullSettings {
        applies: Some(true),
        ..HullSettings::default()
    };
    let tall_posts = HullSettings {
        post_height_m: 3.0,
        ..sized.clone()
    };
    let plain = scores(tall_posts.clone(), None);
    assert_eq!(scores(sized.clone(), None), [plain[0], plain[1] * 0.05]);
    let judged = scores(sized, Some(tall_ones()));
    assert!(judged[0] > 0.99 * plain[0] && judged[1] <= 0.051 * plain[1]);
    assert!(scores(tall_posts, Some(tall_ones()))[1] > 0.9 * plain[1]);
    let wrong = Settings {
        hull: HullSettings {
            post_side_m: f64::NAN,
            ..HullSettings::default()
        },
        ..Settings::default()
    };
    let fault = Refiner::new(wrong, &sensor()).expect_err("not a length");
    assert!(fault.to_string().contains("hull.post_side_m"), "{fault}");
}

#[test]
fn what_there_was_no_time_to_judge_is_published_flagged() {
    let (points, detections) = scene();
    let mut refiner =
        Refiner::with_looks(Settings::default(), &sensor(), Some(tall_ones())).expect("settings");
    let mut out = Refined::default();
    refiner.refine_within(7, &points, &detections, &mut || true, &mut out);
    for (object, detection) in out.objects.iter().zip(&detections) {
        assert!(object.is_published() && object.flags == Object::UNREFINED);
        assert_eq!(object.size_m, detection.size_m);
    }
    assert_eq!(out.counters.unrefined, 4);
    // Time for the looks and two of the candidates: the proposals of the others are ranked, whatever their size.
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
fn an_open_heads_logit_ranks() {
    let open = Sensor {
        unknown_logit_at: Some(4),
        ..sensor()
    };
    let (points, mut detections) = scene();
    for (detection, logit) in detections.iter_mut().zip([2.0, -1.0, f32::NAN, 0.0]) {
        detection.embedding[4] = logit;
    }
    let mut refiner = Refiner::new(Settings::default(), &open).expect("settings");
    let mut out = Refined::default();
    refiner.refine(7, &points, &detections, &mut out);
    let expected = [2.0f32, -1.0].map(|x| 0.6 / (1.0 + (-x).exp()));
    assert_eq!([0, 1].map(|i: usize| out.objects[i].score), expected);
    assert_eq!(out.objects[2].score, 0.0);
    // Larger than a road user: behind all others.
    assert!((out.objects[3].score - 0.05 * 0.3).abs() < 1e-6);
}
