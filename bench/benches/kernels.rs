//! Single kernels on a simulated scan, in the order of a frame: voxels, feature rows, the head and the decoding of its boxes,
//! the refiner. Levels of the network: the program `network` prints them.

use criterion::{Criterion, criterion_group, criterion_main};
use mluc_backbone::{Backbone, Precision, Voxels, voxelize};
use mluc_bench::inputs;
use mluc_geometry::{Box3, Random};
use mluc_head::Head;
use mluc_head::decode::{ANCHOR_YAWS_RAD, decode, direct};
use mluc_ipc_types::Detection;
use mluc_refiner::{Refiner, RefinerOutput, Settings};

/// As many candidates as a crowded frame has.
const BOXES: usize = 1024;
const PROPOSALS: usize = 20;

fn backbone(c: &mut Criterion) {
    let (manifest, weights) = inputs::compact();
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
    let scan = inputs::simulated(0).expect("a simulated scan").points;
    let mut group = c.benchmark_group("feature rows");
    for precision in [Precision::F32, Precision::Bf16] {
        let mut backbone =
            Backbone::with_precision(&manifest, &weights, precision).expect("a sound model");
        backbone.run(&scan);
        let (mut cells, mut rows) = backbone.last_rows().expect("rows");
        group.bench_function(precision.to_string(), |b| {
            b.iter(|| backbone.write_rows(&mut cells, &mut rows).expect("room"))
        });
    }
    group.finish();
}

fn head(c: &mut Criterion) {
    let (manifest, weights) = inputs::shipped().expect("the shipped model");
    let scan = inputs::simulated(0).expect("a simulated scan").points;
    let mut backbone = Backbone::new(&manifest, &weights).expect("a sound model");
    let mut head = Head::new(&manifest, &weights).expect("a sound model");
    backbone.run(&scan);
    let (cells, rows) = backbone.last_rows().expect("rows");
    let mut detections = vec![];
    c.bench_function("head/whole", |b| {
        b.iter(|| head.run(&cells, &rows, &mut detections).expect("rows"))
    });
    let mut random = Random::new(2, &[]);
    let anchor = Box3::new([10.0, 0.0, -1.0, 3.9, 1.6, 1.56, ANCHOR_YAWS_RAD[1]]);
    let mut code = |_| [(); 7].map(|()| random.uniform(-0.5, 0.5) as f32);
    let codes: Vec<[f32; 7]> = (0..BOXES).map(&mut code).collect();
    let decoded = |code: &[f32; 7]| {
        let mut found = decode(code, &anchor)?;
        found.yaw_rad = direct(found.yaw_rad, 1);
        Some(found)
    };
    let mut found = Vec::with_capacity(BOXES);
    c.bench_function(&format!("decode/{BOXES} boxes"), |b| {
        b.iter(|| {
            found.clear();
            found.extend(codes.iter().filter_map(decoded));
        })
    });
}

fn refiner(c: &mut Criterion) {
    let frame = inputs::simulated(0).expect("a simulated scan");
    let points = bytemuck::cast_slice(&frame.points);
    let mut refiner =
        Refiner::new(Settings::default(), &inputs::sensor()).expect("default settings");
    let objects = frame.objects.iter().cycle().take(PROPOSALS);
    let detections: Vec<Detection> = objects
        .map(|object| {
            let shape = Box3 {
                size_m: [1.8, 0.7, 1.6],
                yaw_rad: 0.0,
                ..object.box_in_sensor
            };
            inputs::candidate(&shape, 1.0)
        })
        .collect();
    let mut refined = RefinerOutput::default();
    c.bench_function(&format!("refiner/{PROPOSALS} proposals"), |b| {
        b.iter(|| refiner.refine(0, points, &detections, &mut refined))
    });
}

/// One thread, this one: figures of one core compare between machines.
fn on_one_thread(c: &mut Criterion) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1);
    let pool = pool.use_current_thread();
    pool.build_global().expect("no pool was there before");
    backbone(c);
    head(c);
    refiner(c);
}

criterion_group!(benches, on_one_thread);
criterion_main!(benches);
