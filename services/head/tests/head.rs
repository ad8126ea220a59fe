//! The head on feature rows made by hand.

use mluc_geometry::{Box3, iou_bev};
use mluc_head::decode::{Anchors, direction_bin, encode};
use mluc_head::{Detection, Head, HeadCounts, HeadError};
use mluc_model::{Grid, HeadKind, Manifest, Network, WeightSet, formula_uniform, formula_weights};

type Fallible = Result<(), Box<dyn std::error::Error>>;

fn manifest(head: HeadKind, generic: usize) -> Manifest {
    let grid = Grid::kitti_compact().within([0.0, 6.4], [-3.2, 3.2]);
    let network = Network { head, generic, ..Network::compact(grid, 3) };
    Manifest::untrained("small", network)
}

/// Heads that copy the first channels of a row, in the order of the heads. A metric head has 6 objectness, 3 embedding, 42 box, 12 direction.
fn copying(manifest: &Manifest) -> WeightSet {
    let network = &manifest.network;
    let channels = network.feature_channels();
    let mut weights = formula_weights(network);
    let mut channel = 0;
    for (name, cout) in network.heads() {
        let mut data = vec![0.0; cout * channels];
        for output in 0..cout {
            data[output * channels + channel] = 1.0;
            channel += 1;
        }
        weights.insert(format!("{name}.weight"), vec![cout, channels, 1, 1], data);
        weights.insert(format!("{name}.bias"), vec![cout], vec![0.0; cout]);
    }
    weights
}

/// A row whose first `anchors` logits say that nothing is there.
fn quiet_row(manifest: &Manifest, anchors: usize) -> Vec<f32> {
    let mut row = vec![0.0; manifest.network.feature_channels()];
    row[..anchors].fill(-9.0);
    row
}

/// Sets an anchor of a row with an embedding of 3 so that it gives the box `found`.
fn claim(row: &mut [f32], at: &Anchors, [cell, anchor]: [usize; 2], found: &Box3, logit: f32) {
    row[anchor] = logit;
    let codes = at.per_cell() + 3;
    let code = encode(found, &at.anchor(cell, anchor));
    row[codes + anchor * 7..][..7].copy_from_slice(&code.map(|value| value as f32));
    row[codes + at.per_cell() * 7 + anchor * 2 + direction_bin(found.yaw_rad)] = 5.0;
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

fn box_of(d: &Detection) -> Box3 {
    Box3::from_f32(d.center_m, d.size_m, d.yaw_rad)
}

#[test]
fn a_claimed_box_comes_out_with_its_class_direction_and_scores() -> Fallible {
    let mut manifest = manifest(HeadKind::Metric, 0);
    manifest.thresholds.eds_normalised_max = 1.4;
    let mut head = Head::new(&manifest, &copying(&manifest))?;
    let anchors = Anchors::new(&manifest);
    let car = Box3::new([3.1, -0.9, -0.8, 4.2, 1.7, 1.5, -2.5]);
    let cyclist = Box3::new([5.4, 2.2, -0.9, 1.8, 0.6, 1.7, 0.3]);
    let (car_cell, cyclist_cell) = (5 * 16 + 7, 13 * 16 + 13);
    let mut rows = [(); 3].map(|()| quiet_row(&manifest, 6));
    claim(&mut rows[0], &anchors, [car_cell, 0], &car, 3.0);
    rows[0][6..9].copy_from_slice(&[3.0, 0.0, 0.0]);
    claim(&mut rows[2], &anchors, [cyclist_cell, 5], &cyclist, 1.0);
    rows[2][6..9].fill(1.0);

    let cells = [car_cell as u32, 100, cyclist_cell as u32];
    let (found, counts) = detect(&mut head, &cells, &rows.concat())?;
    assert_eq!((found.len(), counts.candidates), (2, 2));
    let (first, second) = (found[0], found[1]);
    assert_eq!((first.class_id, second.class_id), (0, 2));
    let candidates = (first.is_candidate(), second.is_candidate());
    assert_eq!(candidates, (false, true), "the centre is no known class");
    assert_eq!(first.cell, car_cell as u32);
    for (found, expected) in [(first, car), (second, cyclist)] {
        let found = box_of(&found);
        let pairs = found.center_m.iter().zip(expected.center_m);
        let pairs = pairs.chain(found.size_m.iter().zip(expected.size_m));
        let mut pairs = pairs.chain([(&found.yaw_rad, expected.yaw_rad)]);
        assert!(pairs.all(|(a, b)| (a - b).abs() < 1e-4), "{found:?}");
    }
    let near = |a: f32, b: f32| assert!((a - b).abs() < 1e-5, "{a} is not {b}");
    near(first.eds_normalised, 2.0);
    near(second.eds_normalised, 1.0);
    near(first.objectness, 1.0 / (1.0 + (-3.0f32).exp()));
    near(second.score, second.objectness / 3.0);
    Ok(())
}

#[test]
fn damaged_rows_are_counted_and_limits_are_said() -> Fallible {
    let mut manifest = manifest(HeadKind::Metric, 0);
    manifest.thresholds.candidates_max = 5;
    manifest.thresholds.boxes_max = 2;
    let mut head = Head::new(&manifest, &copying(&manifest))?;
    let anchors = Anchors::new(&manifest);
    let mut rows = [(); 7].map(|()| quiet_row(&manifest, 6));
    for (cell, row) in rows.iter_mut().enumerate() {
        let apart = Box3::new([10.0 * cell as f64, 0.0, -1.0, 2.0, 1.0, 1.0, 0.0]);
        claim(row, &anchors, [cell, 0], &apart, cell as f32);
    }
    // Two values are finite, but their box or score is not: the first box code and the first embedding value. The third value makes
    // the objectness of all six anchors of its cell NaN.
    (rows[6][9], rows[5][6], rows[2][0]) = (3e38, 2e19, f32::NAN);
    let (found, counts) = detect(&mut head, &[0, 1, 2, 3, 4, 5, 6], &rows.concat())?;
    let expected = HeadCounts {
        candidates: 6,
        over_candidates_max: 1,
        non_finite: 2 + 6,
        boxes_max_reached: true,
    };
    assert_eq!(counts, expected);
    assert_eq!(found.iter().map(|d| d.cell).collect::<Vec<_>>(), [4, 3]);
    Ok(())
}

#[test]
fn wrong_lengths_cells_and_models_are_refused_and_no_rows_are_fine() -> Fallible {
    let mut manifest = manifest(HeadKind::Metric, 0);
    let weights = copying(&manifest);
    let mut head = Head::new(&manifest, &weights)?;
    let none = detect(&mut head, &[], &[])?;
    assert_eq!(none, (vec![], HeadCounts::default()));
    let row = quiet_row(&manifest, 6);
    let error = detect(&mut head, &[0, 1], &row);
    assert!(matches!(error, Err(HeadError::Length { .. })));
    let error = detect(&mut head, &[256], &row);
    assert!(matches!(error, Err(HeadError::Cell { found: 256, .. })));
    manifest.empty_objectness_max = 0.1;
    let error = Head::new(&manifest, &weights).expect_err("it would fire on absent cells");
    assert!(error.to_string().contains("0.1"), "{error}");
    Ok(())
}

#[test]
fn random_rows_give_the_same_bits_with_one_and_two_threads_and_little_overlap() -> Fallible {
    let mut manifest = manifest(HeadKind::Metric, 0);
    manifest.thresholds.nms_iou = 0.2;
    let cells: Vec<u32> = (0..256).collect();
    let values = 0..256 * manifest.network.feature_channels();
    let rows: Vec<f32> = values.map(|i| formula_uniform("rows", i) as f32).collect();
    let head = Head::new(&manifest, &formula_weights(&manifest.network))?;
    let run = |threads: usize| -> Result<Vec<Detection>, Box<dyn std::error::Error>> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let mut head = head.clone();
        let found = pool.build()?.install(|| detect(&mut head, &cells, &rows));
        Ok(found?.0)
    };
    let found = run(1)?;
    assert!(found.len() > 3);
    let bits = bytemuck::cast_slice::<_, u32>(&found);
    assert_eq!(bits, bytemuck::cast_slice::<_, u32>(&run(2)?));
    for (number, a) in found.iter().enumerate() {
        for b in &found[..number] {
            // The limit is 0.2 before the vote.
            assert!(iou_bev(&box_of(a), &box_of(b)) < 0.5);
            assert!(b.objectness >= a.objectness);
        }
    }
    Ok(())
}

#[test]
fn a_sigmoid_head_takes_the_best_class_of_an_anchor() -> Fallible {
    let manifest = manifest(HeadKind::Sigmoid, 0);
    let mut head = Head::new(&manifest, &copying(&manifest))?;
    let anchors = Anchors::new(&manifest);
    // 6 anchors of 3 class logits, 42 codes, 12 bins.
    let mut row = quiet_row(&manifest, 18);
    let found = Box3::new([3.0, 0.2, -1.0, 4.2, 1.7, 1.5, 0.3]);
    let code = encode(&found, &anchors.anchor(136, 0));
    row[18..25].copy_from_slice(&code.map(|value| value as f32));
    // The anchor belongs to a car; its pedestrian logit is higher.
    row[..3].copy_from_slice(&[1.0, 2.0, -1.0]);
    let (detections, _) = detect(&mut head, &[136], &row)?;
    assert_eq!(detections.len(), 1);
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
    let mut manifest = manifest(HeadKind::Open, 2);
    manifest.thresholds.unknown_min = 0.6;
    let mut head = Head::new(&manifest, &copying(&manifest))?;
    let anchors = Anchors::new(&manifest);
    let cell = 136;
    // 10 objectness, 3 embedding, 70 codes, 20 bins, 1 unknown.
    let mut row = quiet_row(&manifest, 10);
    row[10..13].copy_from_slice(&[0.5, 2.0, -0.3]);
    // The car's first anchor and three anchors without a class claim the same place; the third is the surest, the last one of its size.
    for (anchor, logit, ahead_m) in [(0, 1.0, 0.0), (7, 1.5, 0.1), (8, 2.0, 0.0), (9, 2.0, 0.3)] {
        let [x, y, _] = anchors.anchor(cell, anchor).center_m;
        let found = Box3::new([x + ahead_m, y, -1.0, 3.0, 1.4, 1.9, 0.2]);
        claim(&mut row, &anchors, [cell, anchor], &found, logit);
    }
    let mut with_unknown = |logit: f32| {
        row[103] = logit;
        detect(&mut head, &[cell as u32], &row)
    };
    let (detections, _) = with_unknown(1.5)?;
    let have_class: Vec<bool> = detections.iter().map(Detection::has_class).collect();
    assert_eq!(have_class, [true, false]);
    assert!(detections[0].objectness < detections[1].objectness);
    let moved_m = detections[1].center_m[0] - detections[0].center_m[0];
    assert!((moved_m - 0.15).abs() < 1e-4, "one of its size votes");
    for d in detections {
        assert!(d.is_candidate() && d.class_id < 3);
        assert!((d.unknown_probability - 0.817_574_5).abs() < 1e-6);
        assert_eq!(d.embedding[..3], [0.5, 2.0, -0.3], "that of the cell");
    }
    assert_eq!(with_unknown(1e9)?.1.non_finite, 4);
    // First the doubt is below the threshold, then the object is known: the box without a class is dropped, the other one is known.
    for logit in [0.3, -1.5] {
        let (detections, _) = with_unknown(logit)?;
        assert_eq!(detections.len(), 1);
        assert!(detections[0].has_class() && !detections[0].is_candidate());
    }
    manifest.thresholds.boxes_max = 1;
    let mut head = Head::new(&manifest, &copying(&manifest))?;
    row[103] = 1.5;
    let (detections, counts) = detect(&mut head, &[cell as u32], &row)?;
    assert_eq!((detections.len(), counts.boxes_max_reached), (1, true));
    assert!(detections[0].has_class(), "the box with a class comes first");
    Ok(())
}
