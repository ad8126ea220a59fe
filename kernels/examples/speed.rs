//! Prints GFLOP/s of the convolutions of the networks, and their share of what the registers can do, by the CPU time of
//! one thread. An argument (`avx512bf16`, `avx512`, `avx2`, `neon`, `portable`, ...) picks the registers; without one the
//! best are used.

#[path = "../tests/common/mod.rs"]
mod common;

use common::Random;
use mluc_kernels::{
    ABSENT, Bf16, Element, Epilogue, Gather, Level, Weights, WeightsWinograd, WinogradTiles,
    convolve_at, convolve_winograd_at, spin, weight_gradient_at,
};
use rustix::time::{ClockId, clock_gettime};

/// At least.
const REPEATS: usize = 9;
/// More of them where they are short.
const SECONDS: f64 = 0.1;
/// Some milliseconds.
const PEAK_STEPS: usize = 1_000_000;

/// How the rows of a case are read.
#[derive(Clone, Copy)]
enum Reads {
    /// 3x3 on a map of columns and rows.
    Dense(usize, usize),
    /// 1x1 on such a map.
    Single(usize, usize),
    /// 27 taps on so many rows, of which a share in percent is absent.
    Sparse(usize, usize),
}
use Reads::*;

/// What is read, channels in and out.
const CASES: [(Reads, usize, usize); 11] = [
    (Dense(200, 176), 96, 48),
    (Dense(200, 176), 48, 48),
    (Dense(100, 88), 96, 96),
    (Dense(200, 176), 128, 128),
    (Dense(100, 88), 256, 256),
    (Single(200, 176), 48, 64),
    (Single(200, 176), 128, 63),
    (Sparse(20_000, 80), 4, 16),
    (Sparse(20_000, 50), 16, 16),
    (Sparse(20_000, 50), 32, 32),
    (Sparse(20_000, 50), 48, 48),
];

fn main() {
    let wanted = std::env::args().nth(1);
    let named = |level: &Level| wanted.as_deref().is_none_or(|name| name == level.name());
    let Some(level) = Level::all().into_iter().find(named) else {
        let names = Level::all().into_iter().map(Level::name);
        return eprintln!("this processor has {:?}", names.collect::<Vec<_>>());
    };
    // On this thread: others that want the core do not count.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1);
    if let Err(error) = pool.use_current_thread().build_global() {
        return eprintln!("{error}");
    }
    let peaks = [spin::<f32>, spin::<Bf16>, spin::<u8>].map(|spin| {
        let mut flop = 0.0;
        let seconds = best_seconds(|| flop = spin(level, PEAK_STEPS));
        1e-9 * flop / seconds
    });
    let (name, [f32, bf16, int8]) = (level.name(), peaks);
    println!("{name}: {f32:.0} GFLOP/s f32, {bf16:.0} bf16, {int8:.0} int8 without memory");
    println!("GFLOP/s and share of its peak: f32, bf16, int8, weight gradient in f32");
    for (reads, cin, cout) in CASES {
        let (name, gather, inputs) = gather(reads);
        let found = [
            forward::<f32>(level, &gather, inputs, cin, cout),
            forward::<Bf16>(level, &gather, inputs, cin, cout),
            forward::<u8>(level, &gather, inputs, cin, cout),
            gradient(level, &gather, inputs, cin, cout),
        ];
        let shares = found.iter().zip([f32, bf16, int8, f32]);
        let columns =
            shares.map(|(found, peak)| format!("{found:4.0} {:3.0}%", 100.0 * found / peak));
        let columns = columns.collect::<Vec<_>>().join(" ");
        println!("{:30} {columns}", format!("{name} {cin}->{cout}"));
    }
    println!("by tiles of 2x2 cells, f32: GFLOP/s of the direct sum, and of what is multiplied");
    for (reads, cin, cout) in CASES {
        let Dense(w, h) = reads else { continue };
        let direct = winograd(level, [h, w], cin, cout);
        let multiplied = direct * 16.0 / 36.0;
        let share = 100.0 * multiplied / f32;
        let name = format!("3x3 {w}x{h} {cin}->{cout}");
        println!("{name:30} {direct:4.0} {multiplied:4.0} {share:3.0}%");
    }
}

/// Name, gather, input rows.
fn gather(reads: Reads) -> (String, Gather, usize) {
    match reads {
        Dense(w, h) => (format!("3x3 {w}x{h}"), common::dense(w, h), w * h),
        Single(w, h) => {
            let every = Gather::new(1, (0..(w * h) as u32).collect());
            (format!("1x1 {w}x{h}"), every, w * h)
        }
        // Neighbours near in memory, as in a sorted list of voxels.
        Sparse(rows, off) => {
            let mut random = Random(1);
            let entry = |i: usize| {
                let near = (i / 27 + rows + random.below(2000) - 1000) % rows;
                let absent = random.below(100) < off;
                if absent { ABSENT } else { near as u32 }
            };
            let index = (0..27 * rows).map(entry).collect();
            let name = format!("27 taps {rows}, {off}% off");
            (name, Gather::new(27, index), rows)
        }
    }
}

/// GFLOP/s; absent rows are not counted.
fn gflops(gather: &Gather, cin: usize, cout: usize, work: impl FnMut()) -> f64 {
    let pairs = gather.index.iter().filter(|&&row| row != ABSENT).count();
    2e-9 * (pairs * cin * cout) as f64 / best_seconds(work)
}

fn forward<I: Element>(
    level: Level,
    gather: &Gather,
    inputs: usize,
    cin: usize,
    cout: usize,
) -> f64 {
    // Of u8 all values that these have.
    let input = Random(1).values(inputs * cin).into_iter();
    let input: Vec<I> = input.map(|x| I::from_f32(x * 500.0)).collect();
    let plain = Random(2).values(gather.taps * cin * cout);
    let weights = Weights::pack(gather.taps, cin, cout, &plain);
    let mut output = vec![I::default(); gather.outputs() * cout];
    let relu = Epilogue::RELU;
    gflops(gather, cin, cout, || {
        convolve_at(level, &input, gather, &weights, relu, None, &mut output)
    })
}

fn gradient(level: Level, gather: &Gather, inputs: usize, cin: usize, cout: usize) -> f64 {
    let input = Random(1).values(inputs * cin);
    let dy = Random(1).values(gather.outputs() * cout);
    let mut gradient = vec![0.0; gather.taps * cin * cout];
    gflops(gather, cin, cout, || {
        weight_gradient_at(level, &input, cin, gather, &dy, cout, &mut gradient)
    })
}

/// GFLOP/s of the direct sum that tiles of 2x2 cells stand for.
fn winograd(level: Level, shape: [usize; 2], cin: usize, cout: usize) -> f64 {
    let cells = shape[0] * shape[1];
    let plain = Random(1).values(9 * cin * cout);
    let Some(weights) = WeightsWinograd::pack(cin, cout, &plain) else {
        return 0.0;
    };
    let input = Random(1).values(cells * cin);
    let mut output = vec![0.0; cells * cout];
    let mut tiles = WinogradTiles::new(shape);
    let all: Vec<u32> = (0..cells as u32).collect();
    let seconds = best_seconds(|| {
        tiles.assign(&all, shape);
        convolve_winograd_at(level, &input, &tiles, &weights, Epilogue::RELU, &mut output);
    });
    2e-9 * (9 * cells * cin * cout) as f64 / seconds
}

fn best_seconds(mut work: impl FnMut()) -> f64 {
    let (mut best, begin, mut count) = (f64::INFINITY, thread_seconds(), 0);
    while count < REPEATS || thread_seconds() - begin < SECONDS {
        let start = thread_seconds();
        work();
        best = best.min(thread_seconds() - start);
        count += 1;
    }
    best
}

/// Time of this thread on a core.
fn thread_seconds() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}
