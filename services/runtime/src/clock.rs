//! The two clocks: CLOCK_MONOTONIC measures latency, CLOCK_REALTIME gives the stamps that people read.

use rustix::time::{ClockId, clock_gettime};

/// CLOCK_MONOTONIC, ns: the same clock in all processes of this machine.
pub fn monotonic_ns() -> u64 {
    read_ns(ClockId::Monotonic)
}

/// CLOCK_REALTIME, ns since 1970.
pub fn wall_clock_ns() -> u64 {
    read_ns(ClockId::Realtime)
}

fn read_ns(clock: ClockId) -> u64 {
    let time = clock_gettime(clock);
    time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64
}
