//! Frames made to be expensive: what they cost, and whether the frame's limits hold and are reported.

use std::time::Instant;

use anyhow::Result;
use mluc_bench::clock::timed_again;
use mluc_bench::inputs::candidate;
use mluc_geometry::Box3;
use mluc_ipc_types::{DETECTIONS_MAX, Detection, Object, POINTS_MAX, Point};
use mluc_refiner::RefinerOutput;
use serde_json::{Value, json};

use crate::timing::times;
use crate::{Setup, merged, table};

/// Timed runs of each frame, after one that is not.
const RUNS: usize = 20;
/// Proposals of a frame, and the row beside the wall that they fill, m.
const CROWDS: [(usize, f64); 3] = [(20, 10.0), (DETECTIONS_MAX, 40.0), (DETECTIONS_MAX, 0.0)];

/// Every frame with 20 and with 512 proposals.
pub(crate) fn run(setup: &Setup, limit_ms: Option<f64>) -> Result<()> {
    let mut rows = Vec::new();
    for (name, points) in frames() {
        for (proposals, spread_m) in CROWDS {
            let place = if spread_m == 0.0 { ", one spot" } else { "" };
            let detections = spots(proposals, spread_m);
            let frame = format!("{name}{place}");
            rows.push(measure(setup, frame, &points, &detections, limit_ms)?);
        }
    }
    let text = |rows| println!("{}", table(include_str!("adversarial.txt"), rows));
    let rows = Value::Array(rows);
    setup.print(&rows, || text(&rows))
}

fn measure(
    setup: &Setup,
    frame: String,
    points: &[Point],
    detections: &[Detection],
    limit_ms: Option<f64>,
) -> Result<Value> {
    let mut refiner = setup.refiner()?;
    let mut out = RefinerOutput::default();
    let laps = timed_again(RUNS, || {
        let start = Instant::now();
        let mut is_over =
            || limit_ms.is_some_and(|limit| start.elapsed().as_secs_f64() * 1e3 > limit);
        refiner.read_scan(points);
        refiner.refine_within(0, points, detections, &mut is_over, &mut out);
    });
    let is_flagged = |object: &&Object| object.flags & Object::UNREFINED != 0;
    let unrefined = out.counters.unrefined;
    let about = json!({
        "frame": frame,
        "proposals": detections.len(),
        "refined": detections.len() - unrefined as usize,
        "unrefined": unrefined,
        "flagged": out.objects.iter().filter(is_flagged).count(),
        "work": out.counters.work,
    });
    Ok(merged([about, times(&laps)]))
}

/// From three numbers within half of 0.
type Place = fn([f64; 3]) -> [f64; 3];

/// A wall, a plane, a blob, and all points equal: as many points each as a scan may have.
fn frames() -> [(&'static str, Vec<Point>); 4] {
    const K: [f64; 3] = [0.618_034, 0.414_214, 0.732_051];
    let places: [(_, Place); 4] = [
        ("wall", |[u, v, _]| [12.0, 80.0 * u, 4.0 * v]),
        ("plane", |[u, v, _]| [80.0 * u, 80.0 * v, -1.73]),
        ("blob", |[u, v, w]| {
            [12.0 + 3.0 * u, 1.0 + 3.0 * v, -0.5 + 2.0 * w]
        }),
        ("equal points", |_| [12.0, 1.0, -1.0]),
    ];
    places.map(|(name, place)| {
        let point = |i| {
            let shares = K.map(|k| (f64::from(i) * k).fract() - 0.5);
            let [x, y, z] = place(shares).map(|v| v as f32);
            bytemuck::cast([x, y, z, 0.3])
        };
        (name, (0..POINTS_MAX as u32).map(point).collect())
    })
}

/// Candidates in a row beside the wall, all through the plane and around the blob.
fn spots(count: usize, spread_m: f64) -> Vec<Detection> {
    let spot = |k: usize| {
        let aside_m = (k as f64 / count as f64 - 0.5) * spread_m;
        let shape = Box3::new([12.0, 1.0 + aside_m, -0.8, 2.6, 1.3, 1.8, 0.1]);
        candidate(&shape, 1.0 + k as f32)
    };
    (0..count).map(spot).collect()
}
