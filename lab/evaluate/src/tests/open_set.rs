//! The open-set figures: for the whole data set and parts of it, at many thresholds of the gate, and the choice of a threshold.

use crate::{
    ClassRule, FrameTruth, JudgedFrames, JudgedPoint, LabelledFrame, ObjectKind, SensorDetection,
    SweepPoint, UnknownProtocol, best_index, evaluate, honest,
};
use crate::{open_set::unknown_as_known, pipeline::ModelGate, sweep::quantile_grid};
use mluc_dataset::Label;
use mluc_geometry::{Box3, Calibration, ImageSize};

fn shape(x_m: f64) -> Box3 {
    Box3::new([x_m, 0.0, 0.0, 4.0, 2.0, 1.5, 0.0])
}

fn truth(labels: &[(&str, Box3)]) -> FrameTruth {
    let calibration = Calibration::without_camera();
    let label = |(class, shape): &(&str, Box3)| Label {
        class: (*class).to_owned(),
        image_box_px: [0.0, 0.0, 100.0, 100.0],
        camera_box: calibration.label_from_box_in_sensor(shape),
        ..Label::default()
    };
    FrameTruth { labels: labels.iter().map(label).collect(), calibration, image: ImageSize::KITTI }
}

/// A box of the network: it is unknown if its gate's score is below the threshold.
struct Kept {
    gate: f64,
    score: f64,
    shape: Box3,
}

struct Scene {
    truths: Vec<FrameTruth>,
    kept: Vec<Vec<Kept>>,
    rules: Vec<ClassRule>,
}

impl Scene {
    fn frames(&self, threshold: f64) -> Vec<LabelledFrame> {
        let at = |kept: &Kept| SensorDetection {
            kind: [ObjectKind::Known, ObjectKind::Unknown][usize::from(kept.gate < threshold)],
            class: "car".to_owned(),
            score: kept.score,
            ..SensorDetection::unknown(0.0, kept.shape)
        };
        let with = |(truth, kept): (&FrameTruth, &Vec<Kept>)| {
            truth.with(&kept.iter().map(at).collect::<Vec<_>>())
        };
        self.truths.iter().zip(&self.kept).map(with).collect()
    }
}

/// Sixty frames; two of three have a forklift. Every car is found. Every fifth car and all forklifts look like an unknown object.
fn cars_and_forklifts() -> Scene {
    let cars = [10.0, 12.0, 20.0].map(shape);
    let frame = |i: usize| match i % 3 {
        0 => truth(&[("Car", cars[0]), ("Forklift", shape(30.0))]),
        1 => truth(&[("Car", cars[1])]),
        _ => truth(&[("Car", cars[2]), ("Forklift", shape(40.0))]),
    };
    let kept = |i: usize| {
        let score = 0.5 + (i * 37 % 60) as f64 / 200.0;
        let mut all = vec![Kept {
            gate: if i.is_multiple_of(5) { 1.2 } else { 1.9 },
            score,
            shape: cars[i % 3],
        }];
        if i % 3 != 1 {
            // A box half a metre off still overlaps the object of 4 m x 2 m by 0.5.
            all.push(Kept {
                gate: 1.1 + score / 10.0,
                score: score - 0.2,
                shape: shape(if i.is_multiple_of(3) { 30.0 } else { 40.5 }),
            });
        }
        all
    };
    Scene {
        truths: (0..60).map(frame).collect(),
        kept: (0..60).map(kept).collect(),
        rules: vec![
            ClassRule::known("car", 0.5),
            ClassRule::unknown(&["forklift".to_owned()], 0.1, UnknownProtocol::Literal),
        ],
    }
}

#[test]
fn pooled_frames_give_the_figures_of_the_evaluator() {
    let scene = cars_and_forklifts();
    for threshold in [0.0, 1.15, 1.18, 5.0] {
        let frames = scene.frames(threshold);
        let report = evaluate(&frames, &scene.rules);
        let (known, unknown) = (report.map_known(), *report.unknown().expect("it").main());
        let figures = JudgedFrames::of(&frames, &scene.rules).all();
        assert_eq!((figures.known, figures.unknown[0]), (known, unknown.ap));
        assert_eq!(figures.harmonic(), known.harmonic(unknown.ap));
        assert_eq!(figures.recall_unknown, unknown.recall_percent);
        let as_known = unknown_as_known(&frames, &scene.rules);
        assert_eq!(figures.unknown_as_known, as_known);
        assert_eq!(figures.unknown_labels, 40);
        assert!(figures.unknown[2].all <= figures.unknown[0].all);
    }
}

#[test]
fn a_frame_named_twice_counts_twice() {
    let scene = cars_and_forklifts();
    let judged = JudgedFrames::of(&scene.frames(1.165), &scene.rules);
    let twice: Vec<usize> = (0..60).chain(0..60).collect();
    let figures = judged.figures(&twice);
    assert_eq!(figures.unknown_labels, 80);
    assert_eq!(figures.recall_unknown, judged.all().recall_unknown);
    assert_eq!(figures.unknown[0].all, judged.all().unknown[0].all);
}

#[test]
fn a_threshold_is_chosen_on_one_half_and_judged_on_the_other() {
    let scene = cars_and_forklifts();
    let thresholds = [0.0, 1.12, 1.15, 1.18, 1.3];
    let point = |t: f64| JudgedPoint::of(t, &scene.frames(t), &scene.rules);
    let points = thresholds.map(point);
    let judged = JudgedFrames::of(&scene.frames(1.15), &scene.rules);
    let odd: Vec<usize> = (1..60).step_by(2).collect();
    assert_eq!(points[2].all, judged.all());
    assert_eq!(points[2].halves[1], judged.figures(&odd));
    // Cars are lost from 1.2 on: the best threshold is lower.
    let swept = points.each_ref().map(JudgedPoint::main);
    assert_eq!(thresholds[best_index(&swept)], 1.18);
    let honest = honest(&points).expect("points");
    assert!(honest.thresholds.iter().all(|t| *t <= 1.18 && *t > 0.0));
    // Unbiased figures cannot come from thresholds that were chosen on the judged half.
    let of = |half: usize, threshold: f64| {
        points.iter().find(|p| p.threshold == threshold).expect("it").halves[half].recall_unknown
    };
    let expected = (of(0, honest.thresholds[1]) + of(1, honest.thresholds[0])) / 2.0;
    assert_eq!(honest.figures["recall_unknown"], expected);
}

#[test]
fn the_bootstrap_keeps_the_figure_and_gives_its_spread() {
    let scene = cars_and_forklifts();
    let judged = JudgedFrames::of(&scene.frames(1.165), &scene.rules);
    let spread = judged.bootstrap(200, 1);
    for (name, value) in judged.all().named() {
        assert_eq!(spread[&name][0], value, "{name}");
    }
    // A share p of 40 labels is found: the deviation is that of a share of about 40 draws.
    let recall = judged.all().recall_unknown / 100.0;
    let expected = 100.0 * (recall * (1.0 - recall) / 40.0).sqrt();
    let found = spread["recall_unknown"][1];
    let range = expected / 2.0..expected * 2.0;
    assert!(range.contains(&found), "{found}, expected {expected}");
    assert_eq!(judged.bootstrap(200, 1), spread);
    assert_ne!(judged.bootstrap(200, 2), spread);
    assert_eq!(judged.bootstrap(0, 1)["map_known"][1], 0.0);
}

#[test]
fn the_choice_keeps_nine_tenths_of_the_known() {
    let point = |threshold, map_known, ap_unknown| SweepPoint {
        threshold,
        map_known,
        recall_unknown: 0.0,
        ap_unknown,
    };
    let points = [
        point(1.0, 70.5, 0.0),
        point(1.2, 63.8, 4.0),
        point(1.3, 63.4, 5.0),
        point(1.25, 63.8, 4.0),
    ];
    assert_eq!(points[best_index(&points)].threshold, 1.2);
    assert_eq!(best_index(&[points[0], points[2]]), 0);
    // The threshold of an open head is one half, which is the last point.
    let of_gates = [ModelGate::Eds, ModelGate::Known].map(|gate| gate.best_index(&points));
    assert_eq!(of_gates, [1, 3]);
}

#[test]
fn quantiles_cut_into_equal_parts() {
    let values: Vec<f64> = (0..100).rev().map(f64::from).collect();
    assert_eq!(quantile_grid(&values, 4), [12.0, 37.0, 62.0, 87.0]);
    assert_eq!(quantile_grid(&[3.0, f64::NAN, 3.0], 60), [3.0]);
    assert!(quantile_grid(&[], 60).is_empty());
}
