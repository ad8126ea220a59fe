//! Wall and CPU time of the same piece of work.

use std::time::Instant;

use rustix::time::{ClockId, clock_gettime};

/// Both, ms.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Times {
    pub(crate) wall_ms: f64,
    /// Of all threads of this process.
    pub(crate) cpu_ms: f64,
}

/// Times of `work`.
pub(crate) fn timed(work: impl FnOnce()) -> Times {
    let (start, cpu_start_ms) = (Instant::now(), cpu_ms());
    work();
    Times {
        wall_ms: start.elapsed().as_secs_f64() * 1e3,
        cpu_ms: cpu_ms() - cpu_start_ms,
    }
}

/// The middle of many.
pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

fn cpu_ms() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 / 1e6
}
