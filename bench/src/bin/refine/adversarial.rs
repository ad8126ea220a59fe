//! Frames made to be dear: what they cost, and whether the frame's limits hold and are told.

use std::time::Instant;

use anyhow::Result;
use mluc_geometry::Box3;
use mluc_ipc_types::{DETECTIONS_MAX, Detection, Object, POINTS_MAX, Point};
use mluc_refiner::{RefinerOutput, Settings};
use serde::Serialize;

use crate::proposals::candidate;
use crate::timing::{percentiles, timed};

/// Timed runs of each frame, after one that is not.
const RUNS: usize = 20;

/// What one frame cost.
#[derive(Serialize)]
struct Row {
    frame: &'static str,
    proposals: usize,
    refined: usize,
    unrefined: u32,
    flagged: usize,
    work: u64,
    p50_ms: f64,
    max_ms: f64,
    cpu_p50_ms: f64,
    cpu_max_ms: f64,
}

/// Every frame with 20 and with 512 proposals.
pub(crate) fn run(settings: Settings, limit_ms: Option<f64>, json: bool) -> Result<()> {
    let mut rows = Vec::new();
    for (name, points) in frames() {
        for (proposals, spread_m) in [(20, 10.0), (DETECTIONS_MAX, 40.0), (DETECTIONS_MAX, 0.0)] {
            let detections = spots(proposals, spread_m);
            let name = match spread_m {
                0.0 => name_on_one_spot(name),
                _ => name,
            };
            rows.push(measure(name, &points, &detections, &settings, limit_ms)?);
        }
    }
    if json {
        println!("{}", serde_json::to_string(&rows)?);
    } else {
        print(&rows);
    }
    Ok(())
}

fn measure(
    frame: &'static str,
    points: &[Point],
    detections: &[Detection],
    settings: &Settings,
    limit_ms: Option<f64>,
) -> Result<Row> {
    let mut refiner = crate::refiner(settings.clone())?;
    let mut out = RefinerOutput::default();
    let mut times = Vec::new();
    for run in 0..=RUNS {
        let took = timed(|| {
            let start = Instant::now();
            let mut is_over =
                || limit_ms.is_some_and(|limit| start.elapsed().as_secs_f64() * 1e3 > limit);
            refiner.refine_within(0, points, detections, &mut is_over, &mut out);
        });
        if run > 0 {
            times.push(took);
        }
    }
    let [p50_ms, _, max_ms] = percentiles(times.iter().map(|t| t.wall_ms));
    let [cpu_p50_ms, _, cpu_max_ms] = percentiles(times.iter().map(|t| t.cpu_ms));
    let is_flagged = |object: &&Object| object.flags & Object::UNREFINED != 0;
    let unrefined = out.counters.unrefined;
    Ok(Row {
        frame,
        proposals: detections.len(),
        refined: detections.len() - unrefined as usize,
        unrefined,
        flagged: out.objects.iter().filter(is_flagged).count(),
        work: out.counters.work,
        p50_ms,
        max_ms,
        cpu_p50_ms,
        cpu_max_ms,
    })
}

fn name_on_one_spot(name: &str) -> &'static str {
    match name {
        "wall" => "wall, one spot",
        "plane" => "plane, one spot",
        "blob" => "blob, one spot",
        _ => "equal points, one spot",
    }
}

/// A wall, a plane, a blob, and all points equal: 131,072 points each.
fn frames() -> [(&'static str, Vec<Point>); 4] {
    let share = |i: usize, k: f64| (i as f64 * k).fract() - 0.5;
    let made = |place: &dyn Fn(usize) -> [f64; 3]| -> Vec<Point> {
        (0..POINTS_MAX)
            .map(|i| {
                let [x_m, y_m, z_m] = place(i).map(|v| v as f32);
                Point {
                    x_m,
                    y_m,
                    z_m,
                    intensity: 0.3,
                }
            })
            .collect()
    };
    const K: [f64; 3] = [0.618_034, 0.414_214, 0.732_051];
    [
        (
            "wall",
            made(&|i| [12.0, 80.0 * share(i, K[0]), 4.0 * share(i, K[1])]),
        ),
        (
            "plane",
            made(&|i| [80.0 * share(i, K[0]), 80.0 * share(i, K[1]), -1.73]),
        ),
        (
            "blob",
            made(&|i| {
                [
                    12.0 + 3.0 * share(i, K[0]),
                    1.0 + 3.0 * share(i, K[1]),
                    -0.5 + 2.0 * share(i, K[2]),
                ]
            }),
        ),
        ("equal points", made(&|_| [12.0, 1.0, -1.0])),
    ]
}

/// Candidates in a row beside the wall, all through the plane and around the blob.
fn spots(count: usize, spread_m: f64) -> Vec<Detection> {
    (0..count)
        .map(|k| {
            let aside_m = (k as f64 / count as f64 - 0.5) * spread_m;
            let shape = Box3::new([12.0, 1.0 + aside_m, -0.8, 2.6, 1.3, 1.8, 0.1]);
            candidate(&shape, 1.0 + k as f32)
        })
        .collect()
}

fn print(rows: &[Row]) {
    println!(
        "{:<24} {:>9} {:>7} {:>9} {:>7} {:>10} {:>8} {:>8} {:>8} {:>8}",
        "frame",
        "proposals",
        "refined",
        "unrefined",
        "flagged",
        "work",
        "p50 ms",
        "max ms",
        "CPU p50",
        "CPU max"
    );
    for row in rows {
        println!(
            "{:<24} {:>9} {:>7} {:>9} {:>7} {:>10} {:>8.2} {:>8.2} {:>8.2} {:>8.2}",
            row.frame,
            row.proposals,
            row.refined,
            row.unrefined,
            row.flagged,
            row.work,
            row.p50_ms,
            row.max_ms,
            row.cpu_p50_ms,
            row.cpu_max_ms
        );
    }
}
