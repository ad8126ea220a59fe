//! The head on feature rows of the shipped model, and its parts: decoding boxes, suppression.

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use mluc_backbone::Backbone;
use mluc_bench::inputs;
use mluc_geometry::{Box3, nms_into};
use mluc_head::Head;
use mluc_head::decode::{ANCHOR_YAWS_RAD, decode, direct};

/// As many candidates as a crowded frame has.
const BOXES: usize = 1024;

/// SplitMix64, uniform in 0..1: the same boxes everywhere.
struct Random(u64);

impl Random {
    fn share(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Boxes as anchors around `objects` objects give them: many near each of a few places.
fn boxes(objects: usize) -> Vec<Box3> {
    let mut random = Random(1);
    let places: Vec<[f64; 3]> = (0..objects)
        .map(|_| {
            [
                70.0 * random.share(),
                80.0 * random.share() - 40.0,
                3.0 * random.share(),
            ]
        })
        .collect();
    (0..BOXES)
        .map(|k| {
            let [x, y, yaw] = places[k % objects];
            let mut near = |m: f64| m * (random.share() - 0.5);
            Box3::new([
                x + near(1.0),
                y + near(1.0),
                -1.0,
                3.9,
                1.6,
                1.5,
                yaw + near(0.2),
            ])
        })
        .collect()
}

fn whole(c: &mut Criterion) {
    let (manifest, weights) = inputs::shipped().expect("the shipped model");
    let scan = inputs::simulated(0).expect("a simulated scan").points;
    let mut backbone = Backbone::new(&manifest, &weights).expect("a sound model");
    let mut head = Head::new(&manifest, &weights).expect("a sound model");
    let count = backbone.run(&scan).rows;
    let mut cells = vec![0; count];
    let mut rows = vec![0.0; count * backbone.feature_channels()];
    backbone
        .write_rows(&mut cells, &mut rows)
        .expect("room for all");
    let mut detections = vec![];
    c.bench_function("head/whole", |b| {
        b.iter(|| {
            head.run(&cells, &rows, &mut detections)
                .expect("rows of the model")
        })
    });
}

fn suppression(c: &mut Criterion) {
    let mut group = c.benchmark_group("nms");
    for objects in [10, 50] {
        let boxes = boxes(objects);
        let order: Vec<usize> = (0..boxes.len()).collect();
        let mut kept = Vec::with_capacity(boxes.len());
        group.bench_function(format!("{BOXES} boxes at {objects} objects"), |b| {
            b.iter(|| nms_into(&boxes, &order, 0.01, 500, &mut kept))
        });
    }
    group.finish();
}

fn decoding(c: &mut Criterion) {
    let mut random = Random(2);
    let anchor = Box3::new([10.0, 0.0, -1.0, 3.9, 1.6, 1.56, ANCHOR_YAWS_RAD[1]]);
    let codes: Vec<[f32; 7]> = (0..BOXES)
        .map(|_| [(); 7].map(|()| random.share() as f32 - 0.5))
        .collect();
    c.bench_function(&format!("decode/{BOXES} boxes"), |b| {
        b.iter_batched_ref(
            || Vec::with_capacity(BOXES),
            |found| {
                found.extend(codes.iter().filter_map(|code| {
                    let mut found = decode(code, &anchor)?;
                    found.yaw_rad = direct(found.yaw_rad, 1);
                    Some(found)
                }))
            },
            BatchSize::SmallInput,
        )
    });
}

/// One thread, this one: figures of one core compare between machines.
fn on_one_thread(c: &mut Criterion) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1);
    pool.use_current_thread()
        .build_global()
        .expect("no pool was there before");
    whole(c);
    suppression(c);
    decoding(c);
}

criterion_group!(benches, on_one_thread);
criterion_main!(benches);
