//! Wall and CPU time of the same piece of work.

use std::time::Instant;

use rustix::time::{ClockId, clock_gettime};
use serde::Serialize;

/// Milliseconds.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Lap {
    /// By the clock on the wall.
    pub wall: f64,
    /// That all threads of this process had a processor: says more where others want the processors too.
    pub cpu: f64,
}

/// What has passed since the last call.
pub fn laps() -> impl FnMut() -> Lap {
    let now = || {
        let cpu = clock_gettime(ClockId::ProcessCPUTime);
        let cpu_ms = 1e3 * cpu.tv_sec as f64 + 1e-6 * cpu.tv_nsec as f64;
        (Instant::now(), cpu_ms)
    };
    let mut last = now();
    move || {
        let (wall, cpu) = now();
        let lap = Lap {
            wall: 1e3 * (wall - last.0).as_secs_f64(),
            cpu: cpu - last.1,
        };
        last = (wall, cpu);
        lap
    }
}
