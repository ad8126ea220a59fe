//! Times many frames of one scan.

use crate::report::{Frame, Record, Start};
use anyhow::Result;
use mluc_backbone::{Backbone, Precision};
use mluc_head::{Detection, DetectionKind, Head};
use mluc_model::{Manifest, WeightSet};
use mluc_refiner::{ClusterScorer, Refiner, RefinerOutput, Sensor, Settings};

/// Frames before the timed ones: the first, whose time is reported separately, and one more.
const UNTIMED: usize = 2;

pub(crate) fn measure(
    (manifest, weights, precision): (&Manifest, &WeightSet, Precision),
    points: &[[f32; 4]],
    (rounds, candidates): (usize, Option<usize>),
    record: &mut Record,
) -> Result<()> {
    let mut backbone = Backbone::with_precision(manifest, weights, precision)?;
    backbone.warm_up(manifest)?;
    let mut head = Head::new(manifest, weights)?;
    let cells_max: usize = backbone.map_shape().iter().product();
    let channels = backbone.feature_channels();
    // Filled, so that the memory is touched, as the vehicle's shared memory is.
    let (mut cells, mut rows) = (vec![1; cells_max], vec![1.0; cells_max * channels]);
    let mut detections = Vec::with_capacity(manifest.thresholds.boxes_max as usize);
    let scorer = ClusterScorer::of_model(weights);
    let sensor = Sensor::from_manifest(manifest);
    let mut refiner = Refiner::with_scorer(Settings::default(), &sensor, scorer)?;
    let mut refined = RefinerOutput::default();
    let last_sparse = manifest.network.sparse.last().map_or("", |layer| &layer.name);
    for round in 0..UNTIMED + rounds {
        let mut frame = Frame::default();
        let (start, mut last) = (Start::now(), Start::now());
        let mut part = "voxelize";
        let count = backbone
            .run_in_steps(points, &mut |step| {
                frame.add(part, step, &mut last);
                match step {
                    "voxels" => part = "sparse3d",
                    step if step == last_sparse => part = "dense2d",
                    _ => {}
                }
            })
            .rows;
        let (cells, rows) = (&mut cells[..count], &mut rows[..count * channels]);
        backbone.write_rows(cells, rows)?;
        frame.add("dense2d", "features", &mut last);
        head.run(cells, rows, &mut detections)?;
        frame.add("head", "head", &mut last);
        frame.total_ms = start.elapsed_ms();
        if let Some(count) = candidates {
            let candidates = candidates_at(&detections, count);
            last = Start::now();
            refiner.refine(0, bytemuck::cast_slice(points), &candidates, &mut refined);
            frame.add("refiner", "refiner", &mut last);
        }
        match round {
            0 => record.first_ms.push(frame.total_ms),
            UNTIMED.. => record.frames.push(frame),
            _ => {}
        }
    }
    Ok(())
}

/// `count` candidates: one at every box in turn, later ones shifted by up to 1 m.
fn candidates_at(detections: &[Detection], count: usize) -> Vec<Detection> {
    let repeated = detections.iter().cycle().take(count);
    let at = |(place, detection): (usize, &Detection)| {
        let turn = place / detections.len();
        let (aside_m, angle_rad) = (turn.min(10) as f32 / 10.0, 2.4 * turn as f32);
        let mut candidate = *detection;
        candidate.kind = DetectionKind::Candidate as u32;
        candidate.center_m[0] += aside_m * angle_rad.cos();
        candidate.center_m[1] += aside_m * angle_rad.sin();
        candidate
    };
    repeated.enumerate().map(at).collect()
}
