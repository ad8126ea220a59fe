//! Times many frames of one scan.

use crate::report::{Frame, Record, Start};
use anyhow::Result;
use mluc_backbone::{Backbone, Precision, Step};
use mluc_head::{Detection, DetectionKind, Head};
use mluc_model::{Manifest, Network, WeightSet};
use mluc_refiner::{ClusterScorer, Refiner, RefinerOutput, Sensor, Settings};

/// Frames before the timed ones: the first, whose time is reported separately, and one whose operations are counted.
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
    let network = &manifest.network;
    let last_sparse = network.sparse.last().map_or("", |layer| &layer.name);
    // The head that runs on every row.
    let first_head = network.heads().first().map_or(0, |(_, channels)| *channels);
    let first_head = per_product(channels, first_head);
    for round in 0..UNTIMED + rounds {
        let mut frame = Frame::default();
        let is_counted = round == 1;
        let (start, mut last) = (Start::now(), Start::now());
        let mut part = "voxelize";
        let count = backbone
            .run_in_steps(points, &mut |step| {
                frame.add(part, step.name, &mut last);
                if is_counted {
                    let own = operations(network, &step);
                    record.count(part, (step.name, step.sites), own);
                }
                match step.name {
                    "voxels" => part = "sparse3d",
                    step if step == last_sparse => part = "dense2d",
                    _ => {}
                }
            })
            .rows;
        let (cells, rows) = (&mut cells[..count], &mut rows[..count * channels]);
        backbone.write_rows(cells, rows)?;
        frame.add("dense2d", "features", &mut last);
        let counts = head.run(cells, rows, &mut detections)?;
        frame.add("head", "head", &mut last);
        frame.total_ms = start.elapsed_ms();
        if is_counted {
            let candidates = ("candidates", counts.candidates as usize);
            record.count("head", candidates, [count as f64 * first_head; 2]);
        }
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

/// Operations of a product of a row with the weights of a tap.
fn per_product(cin: usize, cout: usize) -> f64 {
    2.0 * (cin * cout) as f64
}

/// Operations of a step on the rows that exist: by the layer's definition, and as multiplied.
fn operations(network: &Network, step: &Step) -> [f64; 2] {
    if step.name == "rows" {
        let layers = [&network.up1, &network.up2].into_iter();
        let each: f64 = layers.map(|layer| per_product(layer.cin, layer.cout)).sum();
        return [step.sites as f64 * each; 2];
    }
    let sparse = network.sparse.iter().map(|layer| (&layer.name, layer.cin, layer.cout));
    let dense = network.block1.iter().chain(&network.block2);
    let mut layers = sparse.chain(dense.map(|layer| (&layer.name, layer.cin, layer.cout)));
    let layer = layers.find(|(name, ..)| *name == step.name);
    let each = layer.map_or(0.0, |(_, cin, cout)| per_product(cin, cout));
    (step.products)().map(|products| products as f64 * each)
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
