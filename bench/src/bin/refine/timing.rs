//! Times of whole frames with so many candidates.

use std::time::Instant;

use mluc_geometry::{Box3, Random, quantile};
use mluc_refiner::{Refiner, RefinerOutput};

use crate::proposals::{candidate, keyed, proposal};
use crate::scene::Frame;

/// Timed passes over the folder, after one that is not.
pub(crate) const PASSES: u64 = 5;

/// One frame.
pub(crate) struct Timed {
    pub(crate) wall_ms: f64,
    /// By the thread's own CPU time: what remains comparable on a machine with other work.
    pub(crate) cpu_ms: f64,
    /// As the refiner counts it.
    pub(crate) work: u64,
}

/// What a piece of work costs.
pub(crate) fn timed(work: impl FnOnce()) -> Timed {
    let (start, cpu_start_ms) = (Instant::now(), cpu_ms());
    work();
    Timed {
        wall_ms: start.elapsed().as_secs_f64() * 1e3,
        cpu_ms: cpu_ms() - cpu_start_ms,
        work: 0,
    }
}

/// p50, p99 and the largest.
pub(crate) fn percentiles(values: impl Iterator<Item = f64>) -> [f64; 3] {
    let mut values: Vec<f64> = values.collect();
    values.sort_unstable_by(f64::total_cmp);
    [0.5, 0.99, 1.0].map(|share| quantile(&values, share).unwrap_or(0.0))
}

/// The CPU time that this thread has used, ms.
fn cpu_ms() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 / 1e6
}

/// Frames with candidates at the labelled objects in turn, or wherever random points of the scan lie.
pub(crate) fn time(
    frames: &[Frame],
    refiner: &mut Refiner,
    proposals: usize,
    anywhere: bool,
) -> Vec<Timed> {
    let mut out = RefinerOutput::default();
    let mut times = Vec::new();
    for pass in 0..=PASSES {
        for frame in frames.iter().filter(|f| !f.points.is_empty()) {
            let number = frame.number as u64;
            let detections: Vec<_> = (0..proposals)
                .map(|k| {
                    let mut random = keyed([number, k as u64, 1000 + pass]);
                    let proposed = match frame.objects.len() {
                        count if count > 0 && !anywhere => {
                            let object = &frame.objects[k % count];
                            proposal(&object.class, &object.shape, &mut random)
                        }
                        _ => proposal("", &random_place(frame, &mut random), &mut random),
                    };
                    candidate(&proposed, 1.0 + k as f32)
                })
                .collect();
            let mut took = timed(|| refiner.refine(number, &frame.points, &detections, &mut out));
            took.work = out.counters.work;
            if pass > 0 {
                times.push(took);
            }
        }
    }
    times
}

/// A box of 1 m at a random point of the scan: mostly walls and bushes near the sensor.
fn random_place(frame: &Frame, random: &mut Random) -> Box3 {
    let p = frame.points[random.below(frame.points.len())];
    Box3 {
        center_m: [p.x_m, p.y_m, p.z_m].map(f64::from),
        size_m: [1.0; 3],
        yaw_rad: 0.0,
    }
}
