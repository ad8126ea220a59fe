//! One scan, many frames.

use std::time::Instant;

use anyhow::Result;
use mluc_backbone::{Backbone, Precision, Reads, Step};
use mluc_head::Head;
use mluc_kernels::ABSENT;
use mluc_model::{Manifest, Network, WeightSet};

use crate::report::{Frame, Part, Record};

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
    let products = Products::of(network);
    for round in 0..UNTIMED + rounds {
        let mut frame = Frame::default();
        let counting = round == 1;
        let start = Instant::now();
        let mut last = start;
        let mut part = Part::Voxelize;
        let count = backbone
            .run_in_steps(points, &mut |step| {
                frame.add(part, step.name, &mut last);
                part = products.part_after(step.name, part);
                if counting {
                    record.count(&step, products.flop(&step), products.executed(&step));
                    last = Instant::now();
                }
            })
            .rows;
        let (cells, rows) = (&mut cells[..count], &mut rows[..count * channels]);
        backbone.write_rows(cells, rows)?;
        frame.add(Part::Dense2d, "features", &mut last);
        let counts = head.run(cells, rows, &mut detections)?;
        frame.add(Part::Head, "head", &mut last);
        frame.total_ms = start.elapsed().as_secs_f64() * 1e3;
        if counting {
            record.count_rows(count, products.rows_flop(count), counts.candidates);
        }
        match round {
            0 => record.first_ms.push(frame.total_ms),
            UNTIMED.. => record.frames.push(frame),
            _ => {}
        }
    }
    Ok(())
}

/// Channels of every layer, to turn what was read into operations.
struct Products {
    layers: Vec<(String, f64)>,
    last_sparse: String,
    /// Of a feature row: both transposed layers; the head that runs on every row.
    row: [f64; 2],
}

impl Products {
    fn of(network: &Network) -> Products {
        let pair = |cin: usize, cout: usize| 2.0 * (cin * cout) as f64;
        let sparse = network.sparse.iter();
        let dense = network.block1.iter().chain(&network.block2);
        let objectness = network.heads().first().map_or(0, |(_, channels)| *channels);
        Products {
            layers: sparse
                .map(|layer| (layer.name.clone(), pair(layer.cin, layer.cout)))
                .chain(dense.map(|layer| (layer.name.clone(), pair(layer.cin, layer.cout))))
                .collect(),
            last_sparse: network
                .sparse
                .last()
                .map(|layer| layer.name.clone())
                .unwrap_or_default(),
            row: [
                pair(network.up1.cin, network.up1.cout) + pair(network.up2.cin, network.up2.cout),
                pair(network.feature_channels(), objectness),
            ],
        }
    }

    /// The part that begins when `step` has ended.
    fn part_after(&self, step: &str, part: Part) -> Part {
        match step {
            "voxels" => Part::Sparse3d,
            step if step == self.last_sparse => Part::Dense2d,
            _ => part,
        }
    }

    /// Of the input rows that exist, as the layer is defined: the padding and empty voxels are no work.
    fn flop(&self, step: &Step) -> f64 {
        match step.reads {
            // All but the cells at the border have nine.
            Reads::Tiles(_) => 9.0 * step.rows as f64 * self.pair(step),
            _ => self.executed(step),
        }
    }

    /// What the registers multiplied.
    fn executed(&self, step: &Step) -> f64 {
        let pairs = match step.reads {
            Reads::Nothing => 0,
            Reads::Rows(gather) => gather.index.iter().filter(|row| **row != ABSENT).count(),
            Reads::Tiles(tiles) => tiles.products(),
        };
        pairs as f64 * self.pair(step)
    }

    fn pair(&self, step: &Step) -> f64 {
        let layer = self.layers.iter().find(|layer| layer.0 == step.name);
        layer.map_or(0.0, |layer| layer.1)
    }

    fn rows_flop(&self, rows: usize) -> [f64; 2] {
        self.row.map(|row| row * rows as f64)
    }
}
