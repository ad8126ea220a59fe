//! What the registers can do at most, in the precision of the run.

use std::hint::black_box;
use std::time::Instant;

use mluc_backbone::Precision;
use mluc_kernels::{Level, spin, spin_bf16, spin_int8};

/// Steps of a try: some milliseconds.
const STEPS: usize = 500_000;
const TRIES: usize = 15;

/// GFLOP/s of multiply-adds on registers alone (int8: of whole numbers), of one thread times `threads`.
pub(crate) fn gflops(precision: Precision, threads: usize) -> f64 {
    let spin = |level, steps| match precision {
        Precision::F32 => black_box(spin(level, steps)).0,
        Precision::Bf16 => black_box(spin_bf16(level, steps)).0,
        Precision::Int8 => black_box(spin_int8(level, steps)).0,
    };
    let once = |_| {
        let start = Instant::now();
        let flop = spin(Level::best(), STEPS);
        1e-9 * flop / start.elapsed().as_secs_f64()
    };
    threads as f64 * (0..TRIES).map(once).fold(0.0, f64::max)
}
