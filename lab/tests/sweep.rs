//! The gate's threshold: figures for many of them, and the choice of one.

use mluc_geometry::{Box3, Calibration, ImageSize};
use mluc_lab::dataset::Label;
use mluc_lab::evaluate::{
    ClassRule, Kind, NeighbourPolicy, SensorDetection, SweepPoint, TruthFrame, UnknownProtocol,
    View, best_point, evaluate, quantile_grid, sweep,
};

/// A kept box with the score of the gate: unknown below the threshold.
struct Kept {
    class: &'static str,
    score: f64,
    gate: f64,
    box_in_sensor: Box3,
}

fn place(i: usize) -> Box3 {
    Box3::new([
        10.0 + 8.0 * (i % 5) as f64,
        8.0 * (i / 5) as f64 - 16.0,
        -0.9,
        4.0,
        1.8,
        1.6,
        0.4 * i as f64,
    ])
}

fn label(class: &str, box_in_sensor: &Box3) -> Label {
    Label {
        class: class.to_owned(),
        truncated: 0.0,
        occluded: 0,
        alpha_rad: 0.0,
        image_box_px: [0.0, 0.0, 100.0, 100.0],
        camera_box: Calibration::without_camera().label_from_box_in_sensor(box_in_sensor),
        score: None,
    }
}

/// Frames of ten cars and two vans, all kept as cars; the gate's score of the cars is 1 to 2, that of the vans 0.5 to
/// 1.5.
fn scene(frames: usize) -> (Vec<TruthFrame>, Vec<Vec<Kept>>) {
    let view = View {
        calibration: Calibration::without_camera(),
        image: ImageSize::KITTI,
    };
    let mut truths = Vec::new();
    let mut kept = Vec::new();
    for f in 0..frames {
        let class = |i: usize| if i < 10 { "Car" } else { "Van" };
        let labels: Vec<Label> = (0..12).map(|i| label(class(i), &place(i))).collect();
        truths.push(TruthFrame {
            labels: labels.into(),
            view,
        });
        let box_of = |i: usize| {
            let noise = ((f * 12 + i) * 7919 % 1000) as f64 / 1000.0;
            let gate = if i < 10 { 1.0 + noise } else { 0.5 + noise };
            Kept {
                class: "car",
                score: 0.2 + 0.7 * noise,
                gate,
                box_in_sensor: place(i),
            }
        };
        kept.push((0..12).map(box_of).collect());
    }
    (truths, kept)
}

fn gate(kept: &[Kept], threshold: f64) -> Vec<SensorDetection> {
    let one = |k: &Kept| {
        let unknown = k.gate < threshold;
        SensorDetection {
            kind: if unknown { Kind::Unknown } else { Kind::Known },
            class: if unknown { "unknown" } else { k.class }.to_owned(),
            score: if unknown { 1.0 / k.gate } else { k.score },
            box_in_sensor: k.box_in_sensor,
        }
    };
    kept.iter().map(one).collect()
}

fn rules() -> Vec<ClassRule> {
    vec![
        ClassRule::known("car", 0.7, NeighbourPolicy::Official),
        ClassRule::unknown(&["van".to_owned()], 0.1, UnknownProtocol::Literal),
    ]
}

#[test]
fn a_closed_gate_is_the_closed_set() {
    let (truths, kept) = scene(20);
    let points = sweep(&truths, &rules(), &[f64::NEG_INFINITY], |i, t| {
        gate(&kept[i], t)
    });
    let frames: Vec<_> = truths
        .iter()
        .zip(&kept)
        .map(|(t, k)| t.with(&gate(k, f64::NEG_INFINITY)))
        .collect();
    let summary = evaluate(&frames, &rules())
        .summary
        .expect("an unknown group");
    assert_eq!(points[0].map_known.to_bits(), summary.map_known.to_bits());
    assert_eq!(
        (
            points[0].ap_unknown,
            points[0].recall_unknown,
            points[0].map_harm
        ),
        (0.0, 0.0, 0.0)
    );
    // Every car is found; a van called a car is neither right nor wrong.
    assert_eq!(points[0].map_known, 100.0);
}

#[test]
fn opening_the_gate_gives_knowns_away_for_unknowns() {
    let (truths, kept) = scene(40);
    let all: Vec<f64> = kept.iter().flatten().map(|k| k.gate).collect();
    let mut thresholds = vec![f64::NEG_INFINITY];
    thresholds.extend(quantile_grid(&all, 60));
    let points = sweep(&truths, &rules(), &thresholds, |i, t| gate(&kept[i], t));
    assert_eq!(points.len(), 61);
    for pair in points.windows(2) {
        assert!(
            pair[1].map_known <= pair[0].map_known
                && pair[1].recall_unknown >= pair[0].recall_unknown
        );
    }
    let best = best_point(&points, points[0].map_known).expect("a point");
    assert!(
        best.map_known >= 90.0 && best.recall_unknown > 40.0 && best.map_harm > 0.0,
        "{best:?}"
    );
    assert!(points.iter().any(|p| p.map_known < 90.0));
    let again = sweep(&truths, &rules(), &thresholds, |i, t| gate(&kept[i], t));
    assert_eq!(points, again);
}

#[test]
fn the_choice_keeps_nine_tenths_of_the_known() {
    let point = |threshold, map_known, map_harm| SweepPoint {
        threshold,
        map_known,
        recall_unknown: 0.0,
        ap_unknown: 0.0,
        map_harm,
    };
    let points = [
        point(1.0, 70.5, 0.0),
        point(1.2, 63.8, 7.3),
        point(1.3, 63.4, 9.0),
        point(1.25, 64.0, 7.3),
    ];
    assert_eq!(best_point(&points, 70.5).map(|p| p.threshold), Some(1.2));
    assert_eq!(best_point(&points[2..3], 70.5), None);
}

#[test]
fn quantiles_cut_into_equal_parts() {
    let values: Vec<f64> = (0..100).rev().map(f64::from).collect();
    assert_eq!(quantile_grid(&values, 4), [12.0, 37.0, 62.0, 87.0]);
    assert_eq!(quantile_grid(&[3.0, f64::NAN, 3.0], 60), [3.0]);
    assert!(quantile_grid(&[], 60).is_empty());
}

/// As many frames and thresholds as a validation has must not take long.
#[test]
fn four_hundred_frames_at_sixty_thresholds() {
    let (truths, kept) = scene(400);
    let thresholds: Vec<f64> = (0..60).map(|i| 0.5 + f64::from(i) / 40.0).collect();
    let start = std::time::Instant::now();
    let points = sweep(&truths, &rules(), &thresholds, |i, t| gate(&kept[i], t));
    let elapsed = start.elapsed();
    println!("400 frames, 60 thresholds: {elapsed:?}");
    assert_eq!(points.len(), 60);
    // A fifth of a second on two cores; the limit leaves room for a busy machine.
    assert!(elapsed.as_secs() < 20, "{elapsed:?}");
}
