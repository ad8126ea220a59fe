//! Voxelization, and every level of the network by itself, on a simulated scan with one thread.
//!
//! A level cannot be run alone: whole frames are run, and the time of the one level is taken out of them.

use std::time::{Duration, Instant};

use criterion::{Criterion, criterion_group, criterion_main};
use mluc_backbone::{Backbone, Precision, Voxels, voxelize};
use mluc_bench::inputs;

/// Time that a level's frames may take in all.
const BUDGET: Duration = Duration::from_secs(2);
const PRECISIONS: [Precision; 2] = [Precision::F32, Precision::Bf16];

fn voxelization(c: &mut Criterion) {
    let (manifest, _) = inputs::compact();
    let grid = &manifest.network.grid;
    let mut group = c.benchmark_group("voxelize");
    for points in [20_000, 60_000, 120_000] {
        let scan = inputs::scan_of(points).expect("a simulated scan");
        let mut voxels = Voxels::new(grid);
        group.bench_function(format!("{points} points"), |b| {
            b.iter(|| voxelize(&scan, grid, true, &mut voxels))
        });
    }
    group.finish();
}

fn levels(c: &mut Criterion) {
    let (manifest, weights) = inputs::compact();
    let scan = inputs::simulated(0).expect("a simulated scan").points;
    for precision in PRECISIONS {
        let mut backbone =
            Backbone::with_precision(&manifest, &weights, precision).expect("a sound model");
        // Twice: the first frame touches memory.
        times(&mut backbone, &scan);
        let found = times(&mut backbone, &scan);
        let frame: Duration = found.iter().map(|(_, took)| *took).sum();
        let mut group = c.benchmark_group(format!("level, {precision}"));
        group
            .sample_size(10)
            .warm_up_time(Duration::from_millis(50));
        for (level, took) in &found {
            // criterion plans with the level's own time, but a whole frame passes.
            let share = took.as_secs_f64() / frame.as_secs_f64();
            group.measurement_time(BUDGET.mul_f64(share.max(1e-6)));
            group.bench_function(level.as_str(), |b| {
                b.iter_custom(|frames| {
                    let frames = (0..frames).map(|_| times(&mut backbone, &scan));
                    frames
                        .flatten()
                        .filter(|(name, _)| name == level)
                        .map(|(_, took)| took)
                        .sum()
                })
            });
        }
        group.finish();
    }
}

/// Each step of a frame; those of one name are added up by the caller.
fn times(backbone: &mut Backbone, scan: &[[f32; 4]]) -> Vec<(String, Duration)> {
    let mut found: Vec<(String, Duration)> = Vec::with_capacity(64);
    let mut last = Instant::now();
    backbone.run_in_steps(scan, &mut |step| {
        let took = last.elapsed();
        match found.iter_mut().find(|(name, _)| name == step.name) {
            Some((_, sum)) => *sum += took,
            None => found.push((step.name.to_string(), took)),
        }
        last = Instant::now();
    });
    found
}

fn feature_rows(c: &mut Criterion) {
    let (manifest, weights) = inputs::compact();
    let scan = inputs::simulated(0).expect("a simulated scan").points;
    let mut group = c.benchmark_group("feature rows");
    for precision in PRECISIONS {
        let mut backbone =
            Backbone::with_precision(&manifest, &weights, precision).expect("a sound model");
        let count = backbone.run(&scan).rows;
        let mut cells = vec![0; count];
        let mut rows = vec![0.0; count * backbone.feature_channels()];
        group.bench_function(precision.to_string(), |b| {
            b.iter(|| {
                backbone
                    .write_rows(&mut cells, &mut rows)
                    .expect("room for all")
            })
        });
    }
    group.finish();
}

/// One thread, this one: figures of one core compare between machines.
fn on_one_thread(c: &mut Criterion) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1);
    pool.use_current_thread()
        .build_global()
        .expect("no pool was there before");
    voxelization(c);
    levels(c);
    feature_rows(c);
}

criterion_group!(benches, on_one_thread);
criterion_main!(benches);
