//! Times of whole frames with so many candidates.

use mluc_bench::clock::{Lap, lap_quantile, timed};
use mluc_bench::inputs::candidate;
use mluc_refiner::{Refiner, RefinerOutput};
use serde_json::{Value, json};

use crate::figure;
use crate::scene::{Frame, keyed, proposal};

/// Timed passes over the folder, after one that is not.
const PASSES: u64 = 5;

/// Of whole frames.
pub(crate) fn times(laps: &[Lap]) -> Value {
    let [p50, p99, max] = [0.5, 0.99, 1.0].map(|q| lap_quantile(laps, q));
    json!({
        "timed_frames": laps.len(),
        "p50_ms": p50.wall, "p99_ms": p99.wall, "max_ms": max.wall,
        "cpu_p50_ms": p50.cpu, "cpu_p99_ms": p99.cpu, "cpu_max_ms": max.cpu,
    })
}

/// The times of a report in words.
pub(crate) fn in_words(report: &Value) -> String {
    let frames = &report["timed_frames"];
    let [p50, p99, max, cpu_p50, cpu_p99] = ["p50", "p99", "max", "cpu_p50", "cpu_p99"]
        .map(|key| format!("{:.2} ms", figure(report, &format!("{key}_ms"))));
    format!(
        "p50 {p50}, p99 {p99}, max {max} over {frames} frames; CPU time p50 {cpu_p50}, p99 {cpu_p99}"
    )
}

/// Frames with candidates at the labelled objects in turn; and the work of each.
pub(crate) fn time(frames: &[Frame], refiner: &mut Refiner, proposals: usize) -> (Value, Vec<f64>) {
    let mut out = RefinerOutput::default();
    let (mut laps, mut work) = (Vec::new(), Vec::new());
    for pass in 0..=PASSES {
        for frame in frames.iter().filter(|f| !f.points.is_empty()) {
            let number = frame.number as u64;
            let detections: Vec<_> = (0..proposals)
                .map_while(|k| {
                    let mut random = keyed([number, k as u64, 1000 + pass]);
                    let object = frame.objects.iter().cycle().nth(k)?;
                    let proposed = proposal(&object.class, &object.shape, &mut random);
                    Some(candidate(&proposed, 1.0 + k as f32))
                })
                .collect();
            let lap = timed(|| refiner.refine(number, &frame.points, &detections, &mut out));
            if pass > 0 {
                laps.push(lap);
                work.push(out.counters.work as f64);
            }
        }
    }
    (times(&laps), work)
}
