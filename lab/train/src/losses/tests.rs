//! Each loss against its formula, each gradient against differences.

use mluc_geometry::Random;

use super::boxes::{boxes, direction};
use super::cells::{metric, unknown};
use super::objectness::{focal, objectness};
use super::*;
use crate::batch_targets::{RowClass, RowPositive};
use crate::targets::{CellClass, Positive, Targets};
use crate::testing::assert_gradient;

const SETTINGS: LossSettings = LossSettings {
    prototype_scale: 1.5,
    variance_weight: 0.1,
    center_loss_weight: 0.4,
    push_weight: 0.4,
    unknown_weight: 0.9,
};

/// Two cells with an object each; the first of them is `first`.
fn batch(first: CellClass) -> BatchTargets {
    let positive = |row, anchor, bin| RowPositive {
        row,
        anchor,
        codes: [0.1, -0.3, 0.2, 0.5, -0.1, 0.0, 0.9],
        bin,
        weight: 0.5,
    };
    let class = |row, is, weight| RowClass {
        row,
        is,
        weight,
        share: 0.5,
    };
    BatchTargets {
        labels: vec![],
        labelled: vec![0, 1],
        frame_weight: vec![0.5],
        positives: vec![positive(0, 1, 0), positive(1, 0, 1)],
        cells: vec![class(0, first, 0.7), class(1, CellClass::Known(1), 0.3)],
    }
}

fn draw(n: usize, scale: f64) -> Vec<f32> {
    let mut random = Random::new(3, &[n as u64]);
    (0..n).map(|_| (scale * random.normal()) as f32).collect()
}

fn of_cells(f: &[f32], first: CellClass) -> (Losses, Vec<f32>) {
    metric(f, &batch(first), SETTINGS, 2)
}

#[test]
fn gradients_are_those_of_the_values() {
    type Loss<'a> = &'a dyn Fn(&[f32]) -> (f64, Vec<f32>);
    let known = CellClass::Known(0);
    let cells = |f: &[f32], first| {
        let (losses, gradient) = of_cells(f, first);
        (losses.total(), gradient)
    };
    let (plan, targets) = presence();
    let (up1, up2) = (draw(8, 1.0), draw(16, 1.0));
    let of_ups = |up1: &[f32], up2: &[f32], number: usize| {
        let (loss, back) = objectness(&[up1.to_vec(), up2.to_vec()], &plan, &targets);
        (loss, back[number].clone())
    };
    let focal = |x: &[f32], positive| {
        let (value, slope) = focal(x[0], positive);
        (f64::from(value), vec![slope])
    };
    let cases: [(&str, Vec<f32>, Loss); 12] = [
        ("focal, object", vec![0.3], &|x| focal(x, true)),
        ("focal, missed object", vec![-4.0], &|x| focal(x, true)),
        ("focal, nothing", vec![0.3], &|x| focal(x, false)),
        ("focal, sure nothing", vec![-4.0], &|x| focal(x, false)),
        ("focal, wrong object", vec![6.0], &|x| focal(x, false)),
        ("boxes", draw(56, 1.0), &|x| boxes(x, &batch(known), 4)),
        ("direction", draw(16, 2.0), &|x| {
            direction(x, &batch(known), 4)
        }),
        ("known", draw(4, 0.7), &|x| cells(x, known)),
        ("unknown", draw(4, 0.7), &|x| cells(x, CellClass::Unknown)),
        ("background", draw(4, 0.7), &|x| {
            cells(x, CellClass::Background)
        }),
        ("objectness, up 1", up1.clone(), &|x| of_ups(x, &up2, 0)),
        ("objectness, up 2", up2.clone(), &|x| of_ups(&up1, x, 1)),
    ];
    for (name, x, loss) in cases {
        assert_gradient(name, &x, &loss(&x).1, 2e-3, |x| loss(x).0);
    }
    let targets = batch(CellClass::Unknown);
    let logits = draw(2, 1.0);
    let (_, gradient) = unknown(&logits, &targets, 0.9);
    assert_gradient("logit", &logits, &gradient, 2e-3, |x| {
        unknown(x, &targets, 0.9).0
    });
    assert!(gradient[0] < 0.0 && gradient[1] > 0.0);
}

#[test]
fn focal_has_the_published_form() {
    for (x, positive) in [
        (0.3f32, true),
        (0.3, false),
        (-4.0, true),
        (-4.0, false),
        (6.0, false),
    ] {
        let p = 1.0 / (1.0 + (-f64::from(x)).exp());
        let expected = if positive {
            -0.25 * (1.0 - p).powi(2) * p.ln()
        } else {
            -0.75 * p * p * (1.0 - p).ln()
        };
        let error = (f64::from(focal(x, positive).0) - expected).abs();
        assert!(error < 1e-5 * (1.0 + expected), "{x} {positive}");
    }
}

#[test]
fn half_a_turn_costs_nothing_in_the_box_loss() {
    let targets = batch(CellClass::Known(0));
    let codes = draw(2 * 4 * 7, 1.0);
    let mut turned = codes.clone();
    let angles = turned.iter_mut().skip(6).step_by(7);
    angles.for_each(|a| *a += std::f32::consts::PI);
    assert!((boxes(&codes, &targets, 4).0 - boxes(&turned, &targets, 4).0).abs() < 1e-5);
}

#[test]
fn metric_loss_is_the_papers() {
    let f = draw(4, 0.7);
    let (losses, _) = of_cells(&f, CellClass::Known(0));
    // Eq. 2 written with distances to the prototypes.
    let mut expected = (0.0, 0.0);
    for (own, label) in batch(CellClass::Known(0)).cells.iter().enumerate() {
        let f = &f[2 * own..][..2];
        let d = [0, 1].map(|m| {
            let squared = |c: usize| (f[c] - if c == m { 1.5 } else { 0.0 }).powi(2);
            squared(0) + squared(1)
        });
        expected.0 += label.weight * (d[own] + d.iter().map(|d| (-d).exp()).sum::<f32>().ln());
        expected.1 += 0.1 * label.share * d[own];
    }
    assert!((losses.metric - f64::from(expected.0)).abs() < 1e-5);
    assert!((losses.variance - f64::from(expected.1)).abs() < 1e-5);
}

/// A frame of 4 x 4 cells with two anchors. Rows: 3 listed and the background; 1 listed half cell and the background.
fn presence() -> (MapPlan, BatchTargets) {
    let half_row = |c: u32| u32::from(c / 4 / 2 != 0 || c % 4 / 2 != 0);
    let plan = MapPlan {
        shape: [1, 4, 4],
        up1_row: (0..16).map(|c| if c < 3 { c } else { 3 }).collect(),
        up2_row: (0..16)
            .map(|c| 4 * half_row(c) + c / 4 % 2 * 2 + c % 2)
            .collect(),
        ..MapPlan::default()
    };
    let mut targets = batch(CellClass::Known(0));
    targets.labels = vec![0; 32];
    (targets.labels[1], targets.labels[2], targets.labels[31]) = (1, -1, -1);
    (plan, targets)
}

#[test]
fn objectness_equals_the_sum_over_every_cell() {
    let (plan, targets) = presence();
    let ups = [draw(8, 1.0), draw(16, 1.0)];
    let (loss, _) = objectness(&ups, &plan, &targets);
    let mut expected = 0.0;
    for at in (0..32).filter(|at| targets.labels[*at] >= 0) {
        let [row1, row2] = plan.up_rows(at / 2);
        let x = ups[0][row1 * 2 + at % 2] + ups[1][row2 * 2 + at % 2];
        expected += 0.5 * f64::from(focal(x, targets.labels[at] == 1).0);
    }
    assert!((loss - expected).abs() < 1e-5);
}

#[test]
fn unknown_objects_are_drawn_to_the_centre_and_background_to_where_eds_is_large() {
    let f = draw(4, 0.7);
    for (first, centre) in [
        (CellClass::Unknown, 0.75f32),
        (CellClass::Background, -0.75),
    ] {
        let (losses, _) = of_cells(&f, first);
        let off = (f[0] - centre).powi(2) + (f[1] - centre).powi(2);
        assert!((losses.center - f64::from(0.4 * 0.7 * off)).abs() < 1e-6);
        // There nothing is left.
        let (losses, _) = of_cells(&[centre, centre, f[2], f[3]], first);
        assert!(losses.center < 1e-12);
    }
    // At both eq. 2 is undecided, but EDS of background is 1 + 4 / (C - 1) times as large.
    let eds = |f: f32| 2.0 * ((f - 1.5).powi(2) + f * f);
    assert!((eds(-0.75) / eds(0.75) - 5.0).abs() < 1e-5);
}

#[test]
fn a_sigmoid_head_learns_one_class_an_anchor() {
    let positive = Positive {
        cell: 1,
        anchor: 2,
        codes: [0.0; 7],
        bin: 0,
    };
    let targets = Targets {
        positives: vec![positive],
        ignored: vec![3],
        cells: vec![],
    };
    // Two cells of four anchors and two classes.
    let batch = BatchTargets::new(&[targets], 2, 4, 2);
    let mut expected = [0; 16];
    expected[6..8].fill(-1);
    expected[8 + 2 * 2 + 1] = 1;
    assert_eq!(batch.labels, expected);
}
