//! After its first frame the path from points to detections allocates no memory: the guard, voxels, sparse and
//! bird's-eye layers, feature rows, heads, suppression, in every precision.

use mluc_backbone::{Backbone, Precision};
use mluc_head::Head;
use mluc_ingest::{DecodeReport, Expected, Guard};
use mluc_model::{Grid, Manifest, Network, formula_uniform, formula_weights};
use mluc_train::quantize::measure_ranges;
use stats_alloc::{INSTRUMENTED_SYSTEM, StatsAlloc};
use std::alloc::System;

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// The number of allocation requests of all threads so far.
fn requests() -> usize {
    let stats = ALLOCATOR.stats();
    stats.allocations + stats.reallocations
}

/// A map of 48 x 48 cells.
fn manifest() -> Manifest {
    let grid = Grid::kitti_compact().within([0.0, 19.2], [-9.6, 9.6]);
    Manifest::untrained("allocation", Network::compact(grid, 3))
}

/// Points over the whole range and a little beyond it.
fn scan(points: usize, seed: &str) -> Vec<[f32; 4]> {
    let value = |index: usize, low: f64, high: f64| {
        (low + (high - low) * formula_uniform(seed, index)) as f32
    };
    let ranges = [(-1.0, 20.0), (-10.0, 10.0), (-3.2, 1.2), (0.0, 1.0)];
    let axes = std::array::from_fn::<_, 4, _>(|axis| (axis, ranges[axis]));
    let point = |i: usize| axes.map(|(axis, (low, high))| value(4 * i + axis, low, high));
    (0..points).map(point).collect()
}

// The file has one test only: requests of another test would be counted, too.
#[test]
fn frames_after_the_first_take_no_memory() {
    let counted = requests();
    drop(std::hint::black_box(Box::new(1_u64)));
    assert!(requests() > counted, "it counts");

    // Small scans come before large ones: nothing may grow on the way.
    let sizes = [800, 300, 0, 6000, 40_000, 131_072, 2000];
    let scans = sizes.map(|points| scan(points, &points.to_string()));
    let manifest = manifest();
    // Weights by formula, with the ranges that int8 needs.
    let weights = formula_weights(&manifest.network);
    let weights = measure_ranges(&manifest, &weights, [Ok(&scans[3])]).expect("values everywhere");
    for precision in Precision::ALL {
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            let pool = pool.build().expect("a pool");
            let backbone = Backbone::with_precision(&manifest, &weights, precision);
            let mut backbone = backbone.expect("a model");
            let mut head = Head::new(&manifest, &weights).expect("a model");
            // These buffers take the place of shared memory.
            let cells_max: usize = backbone.map_shape().iter().product();
            let channels = backbone.feature_channels();
            let (mut cells, mut rows) = (vec![0; cells_max], vec![0.0; cells_max * channels]);
            let mut detections = Vec::with_capacity(manifest.thresholds.boxes_max as usize);
            let mut guard = Guard::new(Expected::new(&manifest, None));
            let mut boxes = 0;
            let mut frame = |points: &[[f32; 4]]| {
                guard.check(bytemuck::cast_slice(points), &DecodeReport::default());
                let count = backbone.run(points).rows;
                let (cells, rows) = (&mut cells[..count], &mut rows[..count * channels]);
                backbone.write_rows(cells, rows).expect("room");
                head.run(cells, rows, &mut detections).expect("rows");
                boxes += detections.len();
            };
            // All frames run inside the pool: a thread that enters the pool from outside allocates.
            let taken = pool.install(|| {
                frame(&scans[0]);
                scans.each_ref().map(|scan| {
                    let before = requests();
                    frame(scan);
                    requests() - before
                })
            });
            let circumstances = format!("{precision}, {threads} threads, {sizes:?} points");
            assert_eq!(taken, [0; 7], "{circumstances}");
            assert!(boxes > 0, "the frames have contents");
        }
    }
}
