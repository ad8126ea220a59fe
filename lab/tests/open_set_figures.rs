//! The open-set figures of parts of a data set: pooled frames, halves, bootstrap.

use mluc_geometry::{Box3, Calibration, ImageSize};
use mluc_lab::dataset::Label;
use mluc_lab::evaluate::{
    ClassRule, Frame, JudgedFrames, Kind, NeighbourPolicy, SensorDetection, TruthFrame,
    UnknownProtocol, View, best_index, bootstrap, evaluate, halves, honest, judged_sweep, sweep,
    unknown_as_known,
};

fn label(class: &str, x_m: f64) -> Label {
    let shape = Box3::new([x_m, 0.0, 0.0, 4.0, 2.0, 1.5, 0.0]);
    Label {
        class: class.to_owned(),
        truncated: 0.0,
        occluded: 0,
        alpha_rad: 0.0,
        image_box_px: [0.0, 0.0, 100.0, 100.0],
        camera_box: Calibration::without_camera().label_from_box_in_sensor(&shape),
        score: None,
    }
}

fn truth(labels: &[(&str, f64)]) -> TruthFrame {
    let labels: Vec<Label> = labels.iter().map(|(class, x)| label(class, *x)).collect();
    TruthFrame {
        labels: labels.into(),
        view: View {
            calibration: Calibration::without_camera(),
            image: ImageSize::KITTI,
        },
    }
}

fn found(kind: Kind, x_m: f64, score: f64) -> SensorDetection {
    SensorDetection {
        kind,
        class: "car".to_owned(),
        score,
        box_in_sensor: Box3::new([x_m, 0.0, 0.0, 4.0, 2.0, 1.5, 0.0]),
    }
}

fn rules() -> Vec<ClassRule> {
    vec![
        ClassRule::known("car", 0.5, NeighbourPolicy::Official),
        ClassRule::unknown(&["forklift".to_owned()], 0.1, UnknownProtocol::Literal),
    ]
}

fn truths() -> Vec<TruthFrame> {
    (0..60)
        .map(|i| match i % 3 {
            0 => truth(&[("Car", 10.0), ("Forklift", 30.0)]),
            1 => truth(&[("Car", 12.0)]),
            _ => truth(&[("Car", 20.0), ("Forklift", 40.0)]),
        })
        .collect()
}

/// Every car is found. A forklift is a car while `e` is above the threshold, else unknown; every fifth car looks like one.
fn detections(index: usize, threshold: f64) -> Vec<SensorDetection> {
    let kind = |e: f64| match e < threshold {
        true => Kind::Unknown,
        false => Kind::Known,
    };
    let rank = 0.5 + (index * 37 % 60) as f64 / 200.0;
    let car = [10.0, 12.0, 20.0][index % 3];
    let car_e = if index.is_multiple_of(5) { 1.2 } else { 1.9 };
    let mut all = vec![found(kind(car_e), car, rank)];
    if index % 3 != 1 {
        let x = if index.is_multiple_of(3) { 30.0 } else { 40.5 };
        all.push(found(kind(1.1 + rank / 10.0), x, rank - 0.2));
    }
    all
}

fn frames(threshold: f64) -> Vec<Frame> {
    let truths = truths();
    let with = |(i, truth): (usize, &TruthFrame)| truth.with(&detections(i, threshold));
    truths.iter().enumerate().map(with).collect()
}

#[test]
fn pooled_frames_give_the_figures_of_the_evaluator() {
    for threshold in [0.0, 1.15, 1.18, 5.0] {
        let frames = frames(threshold);
        let summary = evaluate(&frames, &rules()).summary.expect("open set");
        let figures = JudgedFrames::of(&frames, &rules()).all();
        assert_eq!(figures.known.r40, summary.map_known);
        assert_eq!(figures.unknown[0].r40, summary.ap_unknown);
        assert_eq!(figures.unknown[0].all, summary.ap_unknown_all);
        assert_eq!(figures.harmonic().r40, summary.map_harm);
        assert_eq!(figures.recall_unknown, summary.recall_unknown);
        assert_eq!(
            figures.unknown_as_known,
            unknown_as_known(&frames, &rules())
        );
        assert_eq!(figures.unknown_labels, 40);
        // Half a metre off still overlaps by 0.5 of 4 m x 2 m.
        assert!(figures.unknown[2].all <= figures.unknown[0].all);
    }
}

#[test]
fn a_frame_named_twice_counts_twice() {
    let judged = JudgedFrames::of(&frames(1.165), &rules());
    let twice: Vec<usize> = (0..60).chain(0..60).collect();
    let figures = judged.figures(&twice);
    assert_eq!(figures.unknown_labels, 80);
    assert_eq!(figures.recall_unknown, judged.all().recall_unknown);
    assert_eq!(figures.unknown[0].all, judged.all().unknown[0].all);
}

#[test]
fn a_sweep_over_parts_begins_with_the_whole() {
    let (truths, thresholds) = (truths(), [0.0, 1.12, 1.15, 1.18, 1.3]);
    let [even, odd] = halves(60);
    let parts = vec![(0..60).collect(), even, odd];
    let points = judged_sweep(&truths, &rules(), &thresholds, &parts, |i, at| {
        detections(i, thresholds[at])
    });
    let plain = sweep(&truths, &rules(), &thresholds, detections);
    for (point, plain) in points.iter().zip(&plain) {
        assert_eq!(point.parts[0].known.r40, plain.map_known);
        assert_eq!(point.parts[0].unknown[0].r40, plain.ap_unknown);
    }
    // 1.2 is where cars begin to fall: the best threshold lies below.
    let best = best_index(&points, 0).expect("a point");
    assert_eq!(thresholds[best], 1.18);
    let honest = honest(&points, [1, 2]).expect("halves");
    assert!(honest.thresholds.iter().all(|t| *t <= 1.18 && *t > 0.0));
    // The honest figures cannot come from thresholds that see the judged half.
    let of = |part: usize, threshold: f64| {
        let point = points
            .iter()
            .find(|p| p.threshold == threshold)
            .expect("it");
        point.parts[part].recall_unknown
    };
    let expected = (of(1, honest.thresholds[1]) + of(2, honest.thresholds[0])) / 2.0;
    assert_eq!(honest.figures["recall_unknown"], expected);
}

#[test]
fn the_bootstrap_keeps_the_figure_and_gives_its_spread() {
    let judged = JudgedFrames::of(&frames(1.165), &rules());
    let spread = bootstrap(&judged, 200, 1);
    let named = judged.all().named();
    for (name, value) in named {
        assert_eq!(spread[name][0], value, "{name}");
    }
    // 40 labels of which a share p is found: the deviation of a share of about 40 draws.
    let recall = judged.all().recall_unknown / 100.0;
    let expected = 100.0 * (recall * (1.0 - recall) / 40.0).sqrt();
    let found = spread["recall_unknown"][1];
    assert!(
        (expected / 2.0..expected * 2.0).contains(&found),
        "{found} beside {expected}"
    );
    assert_eq!(bootstrap(&judged, 200, 1), spread);
    assert_ne!(bootstrap(&judged, 200, 2), spread);
    assert_eq!(bootstrap(&judged, 0, 1)["map_known"][1], 0.0);
}
