//! Fixed work, cut into parts, for a program that counts instructions: `.ci/callgrind` runs it under valgrind, `.ci/aarch64`
//! under emulation, and both compare the counts with recorded ones. Prints the name of each part in order.
//!
//! One synthetic scan, a sixteenth of KITTI's range (valgrind is 100 times slower), the network `compact` with weights by formula, one thread. Each
//! [`instructions_mark`] names the part before it; the first part is the loading of the model.

mod scene;

use anyhow::Result;
use mluc_backbone::{Backbone, Precision};
use mluc_head::Head;
use mluc_ipc_types::Point;
use mluc_model::{Grid, Manifest, Network, WeightSet, formula_weights};
use mluc_refiner::{Refiner, RefinerOutput, Sensor, Settings};
use mluc_train::{TrainError, quantize::measure_ranges};
use std::hint::black_box;

/// Frames of each precision; the first touches its memory for the first time.
const FRAMES: usize = 2;
const PRECISIONS: [Precision; 2] = [Precision::F32, Precision::Int8];

/// The counts are written out whenever this function is entered.
#[inline(never)]
fn instructions_mark(part: String, parts: &mut Vec<String>) {
    parts.push(part);
}

fn main() -> Result<()> {
    // The calling thread is the pool, so that every instruction is counted in one place.
    rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build_global()?;
    let (manifest, weights) = model();
    let points = scene::points();
    let weights = measure_ranges(&manifest, &weights, [Ok::<_, TrainError>(points.clone())])?;
    let mut parts = vec![];
    for precision in PRECISIONS {
        network(&manifest, &weights, precision, &points, &mut parts)?;
    }
    refiner(&manifest, &points, &mut parts)?;
    for part in parts {
        println!("{part}");
    }
    Ok(())
}

fn model() -> (Manifest, WeightSet) {
    let grid = Grid::kitti_compact().within([0.0, 17.6], [-10.0, 10.0]);
    let network = Network::compact(grid, 3);
    let weights = formula_weights(&network);
    let mut manifest = Manifest::untrained("instructions", network);
    manifest.thresholds.objectness_min = 0.6;
    (manifest, weights)
}

fn network(
    manifest: &Manifest,
    weights: &WeightSet,
    precision: Precision,
    points: &[[f32; 4]],
    parts: &mut Vec<String>,
) -> Result<()> {
    let mut backbone = Backbone::with_precision(manifest, weights, precision)?;
    let mut head = Head::new(manifest, weights)?;
    let cells_max: usize = backbone.map_shape().iter().product();
    let channels = backbone.feature_channels();
    let (mut cells, mut rows) = (vec![0; cells_max], vec![0.0; cells_max * channels]);
    let mut detections = vec![];
    let last_sparse = manifest.network.sparse.last().map_or("", |layer| layer.name.as_str());
    for frame in 0..FRAMES {
        // All but the last frame count as start: they load, and touch memory for the first time.
        let name = |part: &str| match frame + 1 {
            FRAMES => format!("{precision}.{part}"),
            _ => "start".to_owned(),
        };
        instructions_mark("start".into(), parts);
        let mut part = "voxelize";
        let count = backbone
            .run_in_steps(points, &mut |step| {
                instructions_mark(name(part), parts);
                part = match step.name {
                    "voxels" => "sparse3d",
                    step if step == last_sparse => "dense2d",
                    _ => part,
                };
            })
            .rows;
        let (cells, rows) = (&mut cells[..count], &mut rows[..count * channels]);
        backbone.write_rows(cells, rows)?;
        instructions_mark(name("dense2d"), parts);
        head.run(cells, rows, &mut detections)?;
        instructions_mark(name("head"), parts);
        black_box(&detections);
    }
    Ok(())
}

fn refiner(manifest: &Manifest, points: &[[f32; 4]], parts: &mut Vec<String>) -> Result<()> {
    let points: Vec<Point> = bytemuck::cast_slice(points).to_vec();
    let candidates = scene::candidates();
    let mut refiner = Refiner::new(Settings::default(), &Sensor::from_manifest(manifest))?;
    let mut refined = RefinerOutput::default();
    for frame in 0..FRAMES {
        instructions_mark("start".into(), parts);
        refiner.refine(7, &points, &candidates, &mut refined);
        let last = frame + 1 == FRAMES;
        instructions_mark((if last { "refiner" } else { "start" }).into(), parts);
        black_box(&refined);
    }
    Ok(())
}
