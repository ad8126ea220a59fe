//! One scan, many frames.

use std::time::Instant;

use anyhow::Result;
use mluc_backbone::{Backbone, Precision, Reads, Step};
use mluc_head::Head;
use mluc_kernels::ABSENT;
use mluc_model::{Manifest, Network, WeightSet};

use crate::report::{Frame, Record};

/// Frames before the clock counts: the first one, which has a time of its own, and one whose work is counted.
const UNTIMED: usize = 2;

pub(crate) fn measure(
    (manifest, weights, precision): (&Manifest, &WeightSet, Precision),
    points: &[[f32; 4]],
    (rounds, cold): (usize, bool),
    record: &mut Record,
) -> Result<()> {
    let mut backbone = Backbone::with_precision(manifest, weights, precision)?;
    if !cold {
        backbone.warm_up(manifest)?;
    }
    let mut head = Head::new(manifest, weights)?;
    let cells_max: usize = backbone.map_shape().iter().product();
    let channels = backbone.feature_channels();
    // Touched, as the vehicle's shared memory is.
    let (mut cells, mut rows) = (vec![1; cells_max], vec![1.0; cells_max * channels]);
    let mut detections = Vec::with_capacity(manifest.thresholds.boxes_max as usize);
    let network = &manifest.network;
    let last_sparse = network.sparse.last().map_or("", |layer| &layer.name);
    for round in 0..UNTIMED + rounds {
        let mut frame = Frame::default();
        let counting = round == 1;
        let start = Instant::now();
        let mut last = start;
        let mut part = "voxelize";
        let count = backbone
            .run_in_steps(points, &mut |step| {
                frame.add(part, step.name, &mut last);
                if counting {
                    record.count(part, &step, products(network, &step));
                    last = Instant::now();
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
        frame.total_ms = start.elapsed().as_secs_f64() * 1e3;
        if counting {
            let flop = row_products(network).map(|row| row * count as f64);
            record.count_rows(flop, counts.candidates);
        }
        match round {
            0 => record.first_ms.push(frame.total_ms),
            UNTIMED.. => record.frames.push(frame),
            _ => {}
        }
    }
    Ok(())
}

/// Operations of one product of a row with a layer's weights.
fn pair(cin: usize, cout: usize) -> f64 {
    2.0 * (cin * cout) as f64
}

/// Operations of a step: of the input rows that exist, as the layer is defined (the padding and empty voxels are no
/// work), and what the registers multiplied.
fn products(network: &Network, step: &Step) -> [f64; 2] {
    let sparse = network.sparse.iter().map(|l| (&l.name, l.cin, l.cout));
    let dense = network.block1.iter().chain(&network.block2);
    let mut layers = sparse.chain(dense.map(|l| (&l.name, l.cin, l.cout)));
    let layer = layers.find(|layer| layer.0 == step.name);
    let pair = layer.map_or(0.0, |(_, cin, cout)| pair(cin, cout));
    match step.reads {
        Reads::Nothing => [0.0; 2],
        Reads::Rows(gather) => {
            let rows = gather.index.iter().filter(|row| **row != ABSENT).count();
            [rows as f64 * pair; 2]
        }
        // All but the cells at the border have nine.
        Reads::Tiles(tiles) => [9 * step.rows, tiles.products()].map(|rows| rows as f64 * pair),
    }
}

/// Operations of a feature row: both transposed layers; the head that runs on every row.
fn row_products(network: &Network) -> [f64; 2] {
    let (up1, up2) = (&network.up1, &network.up2);
    let objectness = network.heads().first().map_or(0, |(_, channels)| *channels);
    [
        pair(up1.cin, up1.cout) + pair(up2.cin, up2.cout),
        pair(network.feature_channels(), objectness),
    ]
}
