//! Each loss against its formula, each gradient against differences.

use super::objectness::focal;
use super::*;
use crate::batch_targets::{RowClass, RowPositive};
use crate::targets::{CellClass, Positive, Targets};
use crate::testing::{assert_gradient, assert_slope};
use mluc_geometry::Random;

const SETTINGS: LossSettings =
    LossSettings { prototype_scale: 1.5, variance_weight: 0.1, push_weight: 0.5 };

/// A frame of 4 x 4 cells with two anchors: 3 listed rows and the background of up 1, a listed half cell and the
/// background of up 2. Two cells have an object each; the first of them is `first`.
fn batch(first: CellClass) -> (MapPlan, BatchTargets) {
    let half_row = |c: u32| u32::from(c / 4 / 2 != 0 || c % 4 / 2 != 0);
    let plan = MapPlan {
        shape: [1, 4, 4],
        up1_row: (0..16).map(|c| c.min(3)).collect(),
        up2_row: (0..16).map(|c| 4 * half_row(c) + c / 4 % 2 * 2 + c % 2).collect(),
        ..MapPlan::default()
    };
    let positive = |row, anchor, bin| RowPositive {
        row,
        anchor,
        codes: [0.1, -0.3, 0.2, 0.5, -0.1, 0.0, 0.9],
        bin,
        weight: 0.5,
    };
    let class = |row, is, weight| RowClass { row, is, weight, share: 0.5 };
    let mut targets = BatchTargets {
        labels: vec![0; 32],
        labelled: vec![0, 1],
        frame_weight: vec![0.5],
        positives: vec![positive(0, 1, 0), positive(1, 0, 1)],
        cells: vec![class(0, first, 0.7), class(1, CellClass::Known(1), 0.3)],
    };
    (targets.labels[1], targets.labels[2], targets.labels[31]) = (1, -1, -1);
    (plan, targets)
}

/// Of a network on that frame.
fn outputs() -> Outputs {
    let draw = |n: usize, scale: f64| -> Vec<f32> {
        let mut random = Random::new(3, &[n as u64]);
        (0..n).map(|_| (scale * random.normal()) as f32).collect()
    };
    Outputs {
        presence: [draw(8, 1.0), draw(16, 1.0)],
        embedding: draw(4, 0.7),
        boxes: draw(28, 1.0),
        direction: draw(8, 2.0),
        unknown: draw(2, 1.0),
    }
}

fn run(outputs: &Outputs, first: CellClass) -> (Losses, Outputs) {
    let (plan, targets) = batch(first);
    evaluate(outputs, &plan, &targets, SETTINGS, 2)
}

#[test]
fn gradients_are_those_of_the_values() {
    type Part = fn(&mut Outputs) -> &mut Vec<f32>;
    let parts: [(&str, Part); 6] = [
        ("up 1", |o| &mut o.presence[0]),
        ("up 2", |o| &mut o.presence[1]),
        ("embedding", |o| &mut o.embedding),
        ("boxes", |o| &mut o.boxes),
        ("direction", |o| &mut o.direction),
        ("unknown", |o| &mut o.unknown),
    ];
    use CellClass::{Background, Known, Unknown};
    for first in [Known(0), Unknown, Background] {
        let mut outputs = outputs();
        let (_, mut gradients) = run(&outputs, first);
        let is_right = |slope: f32| (slope < 0.0) == (first == Unknown);
        assert!(is_right(gradients.unknown[0]) && gradients.unknown[1] > 0.0);
        for (name, part) in parts {
            let x = part(&mut outputs).clone();
            assert_gradient(name, &x, part(&mut gradients), 2e-3, |x| {
                let mut outputs = outputs.clone();
                *part(&mut outputs) = x.to_vec();
                run(&outputs, first).0.total()
            });
        }
    }
}

#[test]
fn focal_has_the_published_form() {
    let both = [0.3f32, -4.0, 6.0].map(|x| [(x, true), (x, false)]);
    for (x, positive) in both.into_iter().flatten() {
        let p = 1.0 / (1.0 + (-f64::from(x)).exp());
        let expected = if positive {
            -0.25 * (1.0 - p).powi(2) * p.ln()
        } else {
            -0.75 * p * p * (1.0 - p).ln()
        };
        let (found, slope) = focal(x, positive);
        let error = (f64::from(found) - expected).abs();
        assert!(error < 1e-5 * (1.0 + expected), "{x} {positive}");
        let value = |h: f32| f64::from(focal(x + h, positive).0);
        assert_slope("focal", f64::from(slope), 2e-3, value);
    }
}

#[test]
fn half_a_turn_costs_nothing_in_the_box_loss() {
    let known = CellClass::Known(0);
    let mut turned = outputs();
    turned.boxes.iter_mut().skip(6).step_by(7).for_each(|a| *a += std::f32::consts::PI);
    let [a, b] = [outputs(), turned].map(|outputs| run(&outputs, known).0.boxes);
    assert!((a - b).abs() < 1e-5);
}

#[test]
fn metric_loss_is_the_papers() {
    let (f, (_, targets)) = (outputs().embedding, batch(CellClass::Known(0)));
    let (losses, _) = run(&outputs(), CellClass::Known(0));
    // Eq. 2 written with distances to the prototypes.
    let mut expected = (0.0, 0.0);
    for (own, label) in targets.cells.iter().enumerate() {
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

#[test]
fn objectness_equals_the_sum_over_every_cell() {
    let (plan, targets) = batch(CellClass::Known(0));
    let [up1, up2] = outputs().presence;
    let mut expected = 0.0;
    for at in (0..32).filter(|at| targets.labels[*at] >= 0) {
        let [row1, row2] = plan.up_rows(at / 2);
        let x = up1[row1 * 2 + at % 2] + up2[row2 * 2 + at % 2];
        expected += 0.5 * f64::from(focal(x, targets.labels[at] == 1).0);
    }
    let (losses, _) = run(&outputs(), CellClass::Known(0));
    assert!((losses.objectness - expected).abs() < 1e-5);
}

#[test]
fn unknown_objects_are_drawn_to_the_centre_and_background_to_where_eds_is_large() {
    for (first, centre) in [(CellClass::Unknown, 0.75f32), (CellClass::Background, -0.75)] {
        let mut outputs = outputs();
        let f = &outputs.embedding;
        let off = (f[0] - centre).powi(2) + (f[1] - centre).powi(2);
        let (losses, _) = run(&outputs, first);
        assert!((losses.center - f64::from(0.5 * 0.7 * off)).abs() < 1e-6);
        // There nothing is left.
        outputs.embedding[..2].fill(centre);
        assert!(run(&outputs, first).0.center < 1e-12);
    }
    // At both eq. 2 is undecided, but EDS of background is 1 + 4 / (C - 1) times as large.
    let eds = |f: f32| 2.0 * ((f - 1.5).powi(2) + f * f);
    assert!((eds(-0.75) / eds(0.75) - 5.0).abs() < 1e-5);
}

#[test]
fn a_sigmoid_head_learns_one_class_an_anchor() {
    let positive = Positive { cell: 1, anchor: 2, codes: [0.0; 7], bin: 0 };
    let targets = Targets { positives: vec![positive], ignored: vec![3], cells: vec![] };
    // Two cells of four anchors and two classes.
    let batch = BatchTargets::new(&[targets], 2, 4, 2);
    let mut expected = [0; 16];
    expected[6..8].fill(-1);
    expected[8 + 2 * 2 + 1] = 1;
    assert_eq!(batch.labels, expected);
}
