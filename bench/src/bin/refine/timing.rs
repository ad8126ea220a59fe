//! Times of whole frames.

use crate::scene::{Frame, candidate};
use mluc_geometry::quantile_of;
use mluc_refiner::{Refiner, RefinerOutput};
use rustix::time::{ClockId, clock_gettime};
use serde_json::{Value, json};
use std::time::Instant;

/// Timed passes over the folder, after one that is not timed.
const PASSES: u64 = 5;

/// Refines all frames with so many candidates, at the labelled objects in turn, and adds to the report the times and the counted work of a frame.
pub(crate) fn time(frames: &[Frame], refiner: &mut Refiner, proposals: usize, report: &mut Value) {
    let mut out = RefinerOutput::default();
    let (mut wall_ms, mut cpu_ms, mut work) = (vec![], vec![], vec![]);
    for pass in 0..=PASSES {
        for frame in frames.iter().filter(|frame| !frame.points.is_empty()) {
            let objects = frame.objects.iter().cycle().take(proposals).zip(0..);
            let detections: Vec<_> = objects
                .map(|(object, k)| {
                    candidate(object, [frame.number, k, 1000 + pass], 1.0 + k as f32)
                })
                .collect();
            let points = bytemuck::cast_slice(&frame.points);
            let (start, cpu_start) = (Instant::now(), clock_gettime(ClockId::ProcessCPUTime));
            refiner.refine(frame.number, points, &detections, &mut out);
            let (wall, cpu) = (start.elapsed(), clock_gettime(ClockId::ProcessCPUTime) - cpu_start);
            if pass > 0 {
                wall_ms.push(1e3 * wall.as_secs_f64());
                cpu_ms.push(1e3 * cpu.tv_sec as f64 + 1e-6 * cpu.tv_nsec as f64);
                work.push(out.counters.work as f64);
            }
        }
    }
    report["timed_frames"] = json!(wall_ms.len());
    for (name, q) in [("p50", 0.5), ("p99", 0.99), ("max", 1.0)] {
        report[format!("{name}_ms")] = json!(quantile_of(wall_ms.clone(), q));
        report[format!("cpu_{name}_ms")] = json!(quantile_of(cpu_ms.clone(), q));
        report[format!("work_{name}")] = json!(quantile_of(work.clone(), q));
    }
}
