//! Wall and CPU time of the same piece of work.

use std::time::Instant;

use mluc_geometry::quantile_of;
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
    let mut last = (cpu_ms(), Instant::now());
    move || {
        let (wall, cpu) = (last.1.elapsed(), cpu_ms());
        let lap = Lap {
            wall: 1e3 * wall.as_secs_f64(),
            cpu: cpu - last.0,
        };
        last = (cpu, Instant::now());
        lap
    }
}

fn cpu_ms() -> f64 {
    let cpu = clock_gettime(ClockId::ProcessCPUTime);
    1e3 * cpu.tv_sec as f64 + 1e-6 * cpu.tv_nsec as f64
}

/// What a piece of work takes.
pub fn timed(work: impl FnOnce()) -> Lap {
    let mut lap = laps();
    work();
    lap()
}

/// What a piece of work takes so many times, after one that is not counted.
pub fn timed_again(times: usize, mut work: impl FnMut()) -> Vec<Lap> {
    work();
    (0..times).map(|_| timed(&mut work)).collect()
}

/// A quantile of the wall times, and of the CPU times; 0 without any.
pub fn lap_quantile(laps: &[Lap], q: f64) -> Lap {
    let of = |time: fn(&Lap) -> f64| quantile_of(laps.iter().map(time).collect(), q);
    Lap {
        wall: of(|lap| lap.wall).unwrap_or_default(),
        cpu: of(|lap| lap.cpu).unwrap_or_default(),
    }
}
