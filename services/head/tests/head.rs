//! The head on synthetic-unknown feature rows.

use mluc_geometry::{Box3, iou_bev};
use mluc_head::decode::{Anchors, encode};
use mluc_head::{Detection, Head, HeadCounts, HeadError, Suppression};
use mluc_model::{Grid, HeadKind, Manifest, Network, WeightSet, formula_uniform, formula_weights};

type Fallible = Result<(), Box<dyn std::error::Error>>;

fn manifest() -> Manifest {
    let grid = Grid {
        range_min_m: [0.0, -3.2, -3.0],
        range_max_m: [6.4, 3.2, 1.0],
        ..Grid::kitti_compact()
    };
    Manifest::untrained("small", Network::compact(grid, 3))
}

/// Heads that copy the first channels of a row: 6 objectness, 3 embedding, 42 box, 12 direction.
fn copying(manifest: &Manifest) -> WeightSet {
    let network = &manifest.network;
    let mut weights = formula_weights(network);
    let mut channel = 0;
    for (name, cout) in network.heads() {
        let mut data = vec![0.0; cout * network.feature_channels()];
        for output in 0..cout {
            data[output * network.feature_channels() + channel] = 1.0;
            channel += 1;
        }
        weights.insert(
            format!("{name}.weight"),
            vec![cout, network.feature_channels(), 1, 1],
            data,
        );
        weights.insert(format!("{name}.bias"), vec![cout], vec![0.0; cout]);
    }
    weights
}

/// A row whose anchors are all empty.
fn quiet_row(channels: usize) -> Vec<f32> {
    let mut row = vec![0.0; channels];
    row[..6].fill(-9.0);
    row
}

/// Makes `anchor` of a row claim `found` with an objectness logit and direction bin.
fn claim(
    row: &mut [f32],
    anchors: &Anchors,
    cell: usize,
    anchor: usize,
    found: &Box3,
    logit: f32,
    bin: usize,
) {
    row[anchor] = logit;
    let code = encode(found, &anchors.anchor(cell, anchor));
    row[9 + anchor * 7..][..7].copy_from_slice(&code.map(|value| value as f32));
    row[51 + anchor * 2 + bin] = 5.0;
}

fn detect(
    head: &mut Head,
    cells: &[u32],
    rows: &[f32],
) -> Result<(Vec<Detection>, HeadCounts), HeadError> {
    let mut detections = vec![];
    let counts = head.run(cells, rows, &mut detections)?;
    Ok((detections, counts))
}

#[test]
fn a_claimed_box_comes_out_with_its_class_direction_and_scores() -> Fallible {
    let mut manifest = manifest();
    manifest.thresholds.eds_normalised_max = 1.4;
    let channels = manifest.network.feature_channels();
    let mut head = Head::new(&manifest, &copying(&manifest))?;
    let anchors = Anchors::new(&manifest);
    let car = Box3::new([3.1, -0.9, -0.8, 4.2, 1.7, 1.5, -2.5]);
    let cyclist = Box3::new([5.4, 2.2, -0.9, 1.8, 0.6, 1.7, 0.3]);
    let mut rows = [
        quiet_row(channels),
        quiet_row(channels),
        quiet_row(channels),
    ]
    .concat();
    let (car_cell, cyclist_cell) = (5 * 16 + 7, 13 * 16 + 13);
    claim(
        &mut rows[..channels],
        &anchors,
        car_cell,
        0,
        &car,
        3.0,
        mluc_head::decode::direction_bin(-2.5),
    );
    rows[6..9].copy_from_slice(&[3.0, 0.0, 0.0]);
    claim(
        &mut rows[2 * channels..],
        &anchors,
        cyclist_cell,
        5,
        &cyclist,
        1.0,
        mluc_head::decode::direction_bin(0.3),
    );
    rows[2 * channels + 6..][..3].fill(1.0);

    let (found, counts) = detect(
        &mut head,
        &[car_cell as u32, 100, cyclist_cell as u32],
        &rows,
    )?;
    assert_eq!((found.len(), counts.candidates, counts.boxes), (2, 2, 2));
    let (first, second) = (found[0], found[1]);
    assert_eq!((first.class_id, second.class_id), (0, 2));
    assert_eq!(
        (first.is_candidate(), second.is_candidate()),
        (false, true),
        "the centre is no known class"
    );
    assert_eq!(first.cell, car_cell as u32);
    let near = |a: [f32; 3], b: [f64; 3]| {
        a.iter()
            .zip(b)
            .all(|(a, b)| (f64::from(*a) - b).abs() < 1e-4)
    };
    assert!(
        near(first.center_m, car.center_m) && near(first.size_m, car.size_m),
        "{first:?}"
    );
    assert!((first.yaw_rad + 2.5).abs() < 1e-4 && (second.yaw_rad - 0.3).abs() < 1e-4);
    assert!(
        (first.eds_normalised - 2.0).abs() < 1e-5 && (second.eds_normalised - 1.0).abs() < 1e-5
    );
    assert!((first.objectness - 1.0 / (1.0 + (-3.0f32).exp())).abs() < 1e-6);
    assert!((second.score - second.objectness / 3.0).abs() < 1e-6);
    Ok(())
}

#[test]
fn all_anchors_of_a_cell_share_its_embedding() -> Fallible {
    let manifest = manifest();
    let channels = manifest.network.feature_channels();
    let mut head = Head::new(&manifest, &copying(&manifest))?;
    let anchors = Anchors::new(&manifest);
    let mut row = quiet_row(channels);
    row[6..9].copy_from_slice(&[0.5, 2.0, -0.3]);
    for (anchor, x) in [(0, 0.0), (3, 20.0)] {
        claim(
            &mut row,
            &anchors,
            3,
            anchor,
            &Box3::new([x, 0.0, -1.0, 1.0, 1.0, 1.0, 0.1]),
            2.0,
            0,
        );
    }
    let (found, _) = detect(&mut head, &[3], &row)?;
    assert_eq!(found.len(), 2);
    assert_eq!(found[0].embedding, found[1].embedding);
    assert_ne!(found[0].class_id, found[1].class_id);
    Ok(())
}

#[test]
fn damaged_rows_are_counted_and_limits_are_said() -> Fallible {
    let mut manifest = manifest();
    manifest.thresholds.candidates_max = 5;
    manifest.thresholds.boxes_max = 2;
    let channels = manifest.network.feature_channels();
    // Finite rows may still overflow in a head: the first box code and the first embedding value.
    let mut weights = copying(&manifest);
    for (name, channel) in [("head.box.weight", 9), ("head.embedding.weight", 6)] {
        weights.find_mut(name).ok_or("a head's weights")?.data[channel] = 10.0;
    }
    let mut head = Head::new(&manifest, &weights)?;
    let anchors = Anchors::new(&manifest);
    let mut rows = vec![];
    for cell in 0..7 {
        let mut row = quiet_row(channels);
        let apart = Box3::new([10.0 * cell as f64, 0.0, -1.0, 2.0, 1.0, 1.0, 0.0]);
        claim(&mut row, &anchors, cell, 0, &apart, cell as f32, 0);
        rows.extend(row);
    }
    rows[6 * channels + 9] = f32::MAX;
    rows[5 * channels + 6] = f32::MAX;
    rows[2 * channels] = f32::NAN;
    let (found, counts) = detect(&mut head, &[0, 1, 2, 3, 4, 5, 6], &rows)?;
    assert_eq!(
        (
            counts.candidates,
            counts.over_candidates_max,
            counts.non_finite
        ),
        (6, 1, 2)
    );
    assert!(counts.boxes_max_reached);
    assert_eq!(found.iter().map(|d| d.cell).collect::<Vec<_>>(), [4, 3]);
    Ok(())
}

#[test]
fn wrong_lengths_cells_and_models_are_refused() -> Fallible {
    let mut manifest = manifest();
    let weights = copying(&manifest);
    let channels = manifest.network.feature_channels();
    let mut head = Head::new(&manifest, &weights)?;
    assert!(matches!(
        detect(&mut head, &[0, 1], &vec![0.0; channels]),
        Err(HeadError::Length { .. })
    ));
    assert!(matches!(
        detect(&mut head, &[256], &vec![0.0; channels]),
        Err(HeadError::Cell { found: 256, .. })
    ));
    manifest.empty_objectness_max = 0.1;
    let error = Head::new(&manifest, &weights)
        .expect_err("it would fire on absent cells")
        .to_string();
    assert!(error.contains("0.1"), "{error}");
    Ok(())
}

#[test]
fn random_rows_give_the_same_bits_with_one_and_two_threads_and_no_overlap() -> Fallible {
    let mut manifest = manifest();
    manifest.thresholds.nms_iou = 0.2;
    let channels = manifest.network.feature_channels();
    let cells: Vec<u32> = (0..256).collect();
    let rows: Vec<f32> = (0..256 * channels)
        .map(|i| formula_uniform("rows", i) as f32)
        .collect();
    for suppression in [Suppression::Agnostic, Suppression::PerClass] {
        let head = Head::new(&manifest, &formula_weights(&manifest.network))?
            .with_suppression(suppression);
        let run = |threads: usize| -> Result<Vec<Detection>, Box<dyn std::error::Error>> {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()?;
            let mut head = head.clone();
            Ok(pool.install(|| detect(&mut head, &cells, &rows))?.0)
        };
        let found = run(1)?;
        assert!(found.len() > 3);
        assert_eq!(
            bytemuck::cast_slice::<_, u32>(&found),
            bytemuck::cast_slice::<_, u32>(&run(2)?)
        );
        let box_of = |d: &Detection| {
            let [x, y, z] = d.center_m.map(f64::from);
            let [l, w, h] = d.size_m.map(f64::from);
            Box3::new([x, y, z, l, w, h, d.yaw_rad.into()])
        };
        for (number, a) in found.iter().enumerate() {
            for b in &found[..number] {
                let rivals = suppression == Suppression::Agnostic || a.class_id == b.class_id;
                assert!(!rivals || iou_bev(&box_of(a), &box_of(b)) <= 0.2 + 1e-4);
                assert!(b.objectness >= a.objectness);
            }
        }
    }
    Ok(())
}

#[test]
fn no_rows_no_detections() -> Fallible {
    let manifest = manifest();
    let mut head = Head::new(&manifest, &copying(&manifest))?;
    assert_eq!(
        detect(&mut head, &[], &[])?,
        (vec![], HeadCounts::default())
    );
    Ok(())
}

/// A manifest with another kind of head.
fn manifest_of(head: HeadKind, generic: usize) -> Manifest {
    let network = Network {
        head,
        generic,
        ..manifest().network
    };
    Manifest::untrained("small", network)
}

#[test]
fn a_sigmoid_head_takes_the_best_class_of_an_anchor() -> Fallible {
    let manifest = manifest_of(HeadKind::Sigmoid, 0);
    let mut head = Head::new(&manifest, &copying(&manifest))?;
    let anchors = Anchors::new(&manifest);
    // 6 anchors of 3 class logits, 42 codes, 12 bins.
    let mut row = vec![0.0; manifest.network.feature_channels()];
    row[..18].fill(-9.0);
    let found = Box3::new([3.0, 0.2, -1.0, 4.2, 1.7, 1.5, 0.3]);
    let (cell, anchor) = (136, 0);
    let code = encode(&found, &anchors.anchor(cell, anchor));
    row[18..25].copy_from_slice(&code.map(|value| value as f32));
    // The anchor is a car's; its pedestrian logit is higher.
    (row[0], row[1], row[2]) = (1.0, 2.0, -1.0);
    let (detections, counts) = detect(&mut head, &[cell as u32], &row)?;
    assert_eq!((detections.len(), counts.generic), (1, 0));
    let d = &detections[0];
    let sigmoid = |x: f32| 1.0 / (1.0 + (-x).exp());
    assert_eq!((d.class_id, d.is_candidate()), (1, false));
    assert!((d.score - sigmoid(2.0)).abs() < 1e-6 && d.score == d.objectness);
    assert!((d.probabilities[0] - sigmoid(1.0)).abs() < 1e-6);
    assert_eq!(d.embedding[..4], [1.0, 2.0, -1.0, 0.0]);
    assert!((d.center_m[0] - 3.0).abs() < 1e-4);
    Ok(())
}

#[test]
fn an_open_head_tells_the_unknown_by_its_logit_and_keeps_boxes_without_a_class() -> Fallible {
    let mut manifest = manifest_of(HeadKind::Open, 2);
    manifest.thresholds.unknown_min = 0.6;
    let mut head = Head::new(&manifest, &copying(&manifest))?;
    let anchors = Anchors::new(&manifest);
    // 10 objectness, 3 embedding, 70 codes, 20 bins, 1 unknown.
    let row = |cell: usize, logit: f32| {
        let mut row = vec![0.0; manifest.network.feature_channels()];
        row[..10].fill(-9.0);
        // The car's first anchor and the last size's claim the same place.
        for anchor in [0, 8] {
            row[anchor] = if anchor == 0 { 1.0 } else { 2.0 };
            let at = anchors.anchor(cell, anchor);
            let found = Box3::new([at.center_m[0], at.center_m[1], -1.0, 3.0, 1.4, 1.9, 0.2]);
            let code = encode(&found, &at).map(|value| value as f32);
            row[13 + anchor * 7..][..7].copy_from_slice(&code);
        }
        row[103] = logit;
        row
    };
    let cell = 136;
    let (detections, counts) = detect(&mut head, &[cell as u32], &row(cell, 1.5))?;
    assert_eq!((detections.len(), counts.generic), (2, 1));
    assert!(detections.iter().all(Detection::is_candidate));
    // The box of a class comes first, though the other is surer.
    assert!(detections[0].objectness < detections[1].objectness);
    assert!(
        detections
            .iter()
            .all(|d| (d.unknown_probability - 0.817_574_5).abs() < 1e-6 && d.class_id < 3)
    );
    // Too little doubt for the threshold: the box without a class goes too.
    let (detections, counts) = detect(&mut head, &[cell as u32], &row(cell, 0.3))?;
    assert_eq!(
        (detections.len(), counts.generic, counts.generic_known),
        (1, 0, 1)
    );
    assert!(!detections[0].is_candidate());
    // A known object there: the box without a class goes, the other is known.
    let (detections, counts) = detect(&mut head, &[cell as u32], &row(cell, -1.5))?;
    assert_eq!(
        (detections.len(), counts.generic, counts.generic_known),
        (1, 0, 1)
    );
    assert!(!detections[0].is_candidate());
    Ok(())
}
