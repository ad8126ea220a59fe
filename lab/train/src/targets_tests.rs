//! Targets against the definition, anchor by anchor.

use super::*;
use crate::anchors::nearest;
use mluc_model::{Grid, Manifest, Network};

fn anchors_with(agnostic: &[[f32; 3]]) -> Anchors {
    let network = Network { generic: agnostic.len(), ..Network::compact(Grid::kitti_compact(), 3) };
    let mut manifest = Manifest::untrained("kitti", network);
    manifest.generic.iter_mut().zip(agnostic).for_each(|(anchor, size_m)| anchor.size_m = *size_m);
    Anchors::of(&manifest)
}

fn anchors() -> Anchors {
    anchors_with(&[])
}

fn object(class: usize, bounds: [f64; 7], points: usize) -> LabelledObject {
    LabelledObject::new(Some(class), Box3::new(bounds), points)
}

/// The definition, anchor by anchor.
fn plain(anchors: &Anchors, objects: &[LabelledObject]) -> (Vec<(u32, u32)>, Vec<u32>) {
    let (mut positives, mut ignored) = (vec![], vec![]);
    for class in 0..3 {
        let of_class: Vec<_> = objects.iter().filter(|o| o.class == Some(class)).collect();
        let iou = |a: &Box3, g: &Box3| {
            let ([ax, ay], [gx, gy]) = (nearest(a.size_m, a.yaw_rad), nearest(g.size_m, g.yaw_rad));
            let side = |i: usize, a_size: f64, g_size: f64| {
                let low = (a.center_m[i] - a_size / 2.0).max(g.center_m[i] - g_size / 2.0);
                let high = (a.center_m[i] + a_size / 2.0).min(g.center_m[i] + g_size / 2.0);
                (high - low).max(0.0)
            };
            let both = side(0, ax, gx) * side(1, ay, gy);
            both / (ax * ay + gx * gy - both)
        };
        let mut most = vec![0.0f64; of_class.len()];
        let mut table = vec![];
        for cell in 0..anchors.rows * anchors.columns {
            for anchor in [2 * class, 2 * class + 1] {
                let a = anchors.boxes.anchor(cell, anchor);
                let row: Vec<f64> = of_class.iter().map(|g| iou(&a, &g.bounds)).collect();
                most.iter_mut().zip(&row).for_each(|(m, v)| *m = m.max(*v));
                if row.iter().any(|v| *v > 0.0) {
                    table.push((cell as u32, anchor as u32, row));
                }
            }
        }
        for (cell, anchor, row) in table {
            let best = row.iter().copied().fold(0.0, f64::max);
            let forced = row.iter().zip(&most).any(|(v, m)| *v > 0.0 && (v - m).abs() < 1e-9);
            let limits = &anchors.classes[class];
            if forced || best >= f64::from(limits.matched_iou) {
                positives.push((cell, anchor));
            } else if best >= f64::from(limits.unmatched_iou) {
                ignored.push(cell * 6 + anchor);
            }
        }
    }
    ignored.sort_unstable();
    (positives, ignored)
}

#[test]
fn agrees_with_the_definition_for_every_anchor() {
    let anchors = anchors();
    let objects = vec![
        object(0, [20.3, 3.2, -1.0, 4.1, 1.7, 1.5, 0.3], 50),
        object(0, [23.0, 3.9, -1.0, 3.6, 1.6, 1.5, 1.4], 50),
        object(1, [8.17, -6.03, -0.9, 0.9, 0.6, 1.7, -2.0], 50),
        object(2, [40.0, 10.0, -0.9, 1.8, 0.6, 1.7, 2.9], 50),
        object(0, [70.2, -39.8, -0.9, 4.0, 1.6, 1.7, 0.0], 50),
    ];
    let targets = anchors.assign(&objects);
    let (positives, ignored) = plain(&anchors, &objects);
    let found: Vec<_> = targets.positives.iter().map(|p| (p.cell, p.anchor)).collect();
    assert_eq!(found, positives);
    assert_eq!(targets.ignored, ignored);
    assert!(found.len() > 8 && !ignored.is_empty(), "{found:?}");
}

#[test]
fn weights_balance_objects_and_classes() {
    let objects = [
        object(0, [20.0, 0.0, -1.0, 4.0, 1.7, 1.5, 0.0], 50),
        object(0, [30.0, 0.0, -1.0, 4.0, 1.7, 1.5, 0.0], 50),
        object(1, [30.5, 0.0, -1.0, 0.8, 0.6, 1.5, 0.0], 50),
    ];
    let cells = anchors().assign(&objects).cells;
    let sum = |class| {
        cells.iter().filter(|c| c.is == CellClass::Known(class)).map(|c| c.weight).sum::<f32>()
    };
    assert!((sum(0) - 0.5).abs() < 1e-5 && (sum(1) - 0.5).abs() < 1e-5);
    // The pedestrian inside the second car's footprint keeps its own centre.
    let centre = anchors().cell_at(30.5, 0.0);
    let own = |c: &CellLabel| Some(c.cell) == centre && c.is == CellClass::Known(1);
    assert!(cells.iter().any(own));
}

#[test]
fn a_synthetic_unknown_object_is_found_without_a_class_and_is_no_false_alarm() {
    let known = object(0, [20.0, 10.0, -1.0, 4.0, 1.7, 1.5, 0.0], 50);
    let mut cart = object(0, [20.0, 0.0, -1.0, 2.6, 1.3, 1.9, 0.0], 50);
    (cart.class, cart.synthetic_unknown) = (None, true);
    let open = anchors_with(&[[2.5, 1.3, 1.9], [9.0, 2.6, 3.2]]);
    let targets = open.assign(&[known.clone(), cart.clone()]);
    let of = |y: Range<f64>, classes: Range<u32>| {
        let wanted = |p: &&Positive| {
            let at = open.boxes.anchor(p.cell as usize, 0).center_m[1];
            y.contains(&at) && classes.contains(&(p.anchor / 2))
        };
        targets.positives.iter().filter(wanted).count()
    };
    // The known one has anchors of its class and without one; the synthetic-unknown one only those without.
    assert!(of(8.0..12.0, 0..3) > 0 && of(8.0..12.0, 3..5) > 0);
    assert!(of(-2.0..2.0, 0..3) == 0 && of(-2.0..2.0, 3..5) > 0);
    let centre = open.cell_at(20.0, 0.0).unwrap();
    let cell = targets.cells.iter().find(|c| c.cell == centre).unwrap();
    assert_eq!(cell.is, CellClass::Unknown);
    let sum: f32 = targets.cells.iter().map(|c| c.weight).sum();
    assert!((sum - 1.0).abs() < 1e-5);
    // Without such anchors the class that overlaps it most has to find it.
    let targets = anchors().assign(&[known, cart]);
    let near = |p: &&Positive| open.boxes.anchor(p.cell as usize, 0).center_m[1].abs() < 2.0;
    let found: Vec<_> = targets.positives.iter().filter(near).collect();
    assert!(!found.is_empty() && found.iter().all(|p| p.anchor / 2 == 0));
}

#[test]
fn an_object_of_few_points_or_of_another_kind_is_ignored_and_not_background() {
    let mut other = object(0, [20.0, 0.0, -1.0, 4.0, 1.7, 1.5, 0.0], 50);
    other.class = None;
    for object in [object(0, [20.0, 0.0, -1.0, 4.0, 1.7, 1.5, 0.0], 1), other] {
        let targets = anchors().assign(&[object]);
        assert!(targets.positives.is_empty() && targets.cells.is_empty());
        let centre = anchors().cell_at(20.0, 0.0).unwrap();
        assert!((0..6).all(|a| targets.ignored.contains(&(centre * 6 + a))));
    }
}
