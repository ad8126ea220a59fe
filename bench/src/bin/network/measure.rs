//! One scan, many frames.

use anyhow::Result;
use mluc_backbone::{Backbone, Precision};
use mluc_head::Head;
use mluc_model::{Manifest, WeightSet};

use crate::report::{Frame, Record, Start};

/// Frames before the clock counts: the first one, which has a time of its own, and one more.
const UNTIMED: usize = 2;

pub(crate) fn measure(
    (manifest, weights, precision): (&Manifest, &WeightSet, Precision),
    points: &[[f32; 4]],
    rounds: usize,
    record: &mut Record,
) -> Result<()> {
    let mut backbone = Backbone::with_precision(manifest, weights, precision)?;
    backbone.warm_up(manifest)?;
    let mut head = Head::new(manifest, weights)?;
    let cells_max: usize = backbone.map_shape().iter().product();
    let channels = backbone.feature_channels();
    // Touched, as the vehicle's shared memory is.
    let (mut cells, mut rows) = (vec![1; cells_max], vec![1.0; cells_max * channels]);
    let mut detections = Vec::with_capacity(manifest.thresholds.boxes_max as usize);
    let last_sparse = manifest.network.sparse.last();
    let last_sparse = last_sparse.map_or("", |layer| &layer.name);
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
        match round {
            0 => record.first_ms.push(frame.total_ms),
            UNTIMED.. => record.frames.push(frame),
            _ => {}
        }
    }
    Ok(())
}
