//! Prints GFLOP/s of the convolutions of the networks, and their share of what the registers can do.
//! An argument (`avx512bf16`, `avx512`, `avx2`, `neon`, `portable`, ...) picks the registers; without one the best are
//! used.

use std::{hint::black_box, time::Instant};

use mluc_kernels::{
    ABSENT, Bf16, Epilogue, Gather, Level, Statistics, Weights, WeightsBf16, WeightsInt8,
    WeightsWinograd, WinogradTiles, batch_norm_backward, batch_norm_forward, convolve_at,
    convolve_bf16_at, convolve_int8_at, convolve_winograd_at, spin, spin_bf16, spin_int8,
    weight_gradient_at,
};
use rustix::time::{ClockId, clock_gettime};

/// At least.
const REPEATS: usize = 9;
/// More of them where they are short.
const SECONDS: f64 = 0.1;
/// Some milliseconds.
const PEAK_STEPS: usize = 1_000_000;

fn main() {
    let wanted = std::env::args().nth(1);
    let named = |level: &Level| wanted.as_deref().is_none_or(|name| name == level.name());
    let Some(level) = Level::all().into_iter().find(named) else {
        return eprintln!(
            "this processor has {:?}",
            Level::all()
                .iter()
                .map(|level| level.name())
                .collect::<Vec<_>>()
        );
    };
    let peaks = [
        peak_gflops(|| spin(level, PEAK_STEPS).0),
        peak_gflops(|| spin_bf16(level, PEAK_STEPS).0),
        peak_gflops(|| spin_int8(level, PEAK_STEPS).0),
    ];
    println!(
        "{}: {:.0} GFLOP/s f32, {:.0} bf16, {:.0} int8 on one core without memory",
        level.name(),
        peaks[0],
        peaks[1],
        peaks[2]
    );
    println!(
        "GFLOP/s and share of its peak: forward in f32, bf16, int8, weight gradient in f32; one core by its own time, then \
         two by the clock"
    );
    for (name, gather, inputs, cin, cout) in cases() {
        let run = |threads| measure(level, threads, &gather, inputs, cin, cout);
        let of = [peaks[0], peaks[1], peaks[2], peaks[0]];
        let one = run(1).into_iter().zip(of);
        let one: Vec<_> = one
            .map(|(gflops, peak)| format!("{gflops:4.0} {:3.0}%", 100.0 * gflops / peak))
            .collect();
        let two = run(2).map(|gflops| format!("{gflops:4.0}"));
        println!("{name:30} {}   {}", one.join(" "), two.join(" "));
    }
    println!(
        "3x3 layers by tiles of 2x2 cells, f32: GFLOP/s of the direct sum, and of what is multiplied"
    );
    for (w, h, cin, cout) in LAYERS {
        let gflops = [1, 2].map(|threads| winograd(level, threads, [h, w], cin, cout));
        let multiplied = gflops[0] * 16.0 / 36.0;
        println!(
            "{:30} {:4.0} {multiplied:4.0} {:3.0}%   {:4.0}",
            format!("3x3 {w}x{h} {cin}->{cout}"),
            gflops[0],
            100.0 * multiplied / peaks[0],
            gflops[1]
        );
    }
    if std::env::args().len() > 2 {
        return;
    }
    for channels in [16, 48, 128] {
        for threads in [1, 2] {
            let (forward, backward) = batch_norm(threads, channels);
            println!(
                "batch norm 200x176x{channels}, {threads} threads: {forward:.2} ms, gradient {backward:.2} ms"
            );
        }
    }
}

/// Columns, rows, channels in and out.
const LAYERS: [(usize, usize, usize, usize); 5] = [
    (200, 176, 96, 48),
    (200, 176, 48, 48),
    (100, 88, 96, 96),
    (200, 176, 128, 128),
    (100, 88, 256, 256),
];

/// GFLOP/s of the direct sum that tiles of 2x2 cells stand for.
fn winograd(level: Level, threads: usize, shape: [usize; 2], cin: usize, cout: usize) -> f64 {
    let Ok(pool) = rayon::ThreadPoolBuilder::new().num_threads(threads).build() else {
        return 0.0;
    };
    let mut random = Random(1);
    let mut values =
        |count: usize| -> Vec<f32> { (0..count).map(|_| random.unit() as f32 - 0.5).collect() };
    let cells = shape[0] * shape[1];
    let (input, plain) = (values(cells * cin), values(9 * cin * cout));
    let Some(weights) = WeightsWinograd::pack(cin, cout, &plain) else {
        return 0.0;
    };
    let mut output = values(cells * cout);
    let mut tiles = WinogradTiles::new(shape);
    let all: Vec<u32> = (0..cells as u32).collect();
    let seconds = best_seconds(&pool, || {
        tiles.assign(&all, shape);
        convolve_winograd_at(level, &input, &tiles, &weights, Epilogue::RELU, &mut output);
    });
    2e-9 * (9 * cells * cin * cout) as f64 / seconds
}

/// Milliseconds of batch normalisation with ReLU on a map of 200 x 176 cells.
fn batch_norm(threads: usize, channels: usize) -> (f64, f64) {
    let Ok(pool) = rayon::ThreadPoolBuilder::new().num_threads(threads).build() else {
        return (0.0, 0.0);
    };
    let count = 200 * 176 * channels;
    let mut random = Random(2);
    let x: Vec<f32> = (0..count).map(|_| random.unit() as f32).collect();
    let (mut y, mut dy) = (vec![0.0; count], x.clone());
    let (gamma, beta) = (vec![1.0; channels], vec![0.1; channels]);
    let mut statistics = Statistics::default();
    let forward = best_seconds(&pool, || {
        statistics = batch_norm_forward(&x, channels, 1.0, &gamma, &beta, 1e-3, true, &mut y);
    });
    let (mut dgamma, mut dbeta) = (vec![0.0; channels], vec![0.0; channels]);
    let backward = best_seconds(&pool, || {
        let sums = (&mut dgamma[..], &mut dbeta[..]);
        batch_norm_backward(
            &x,
            &y,
            &mut dy,
            channels,
            1.0,
            &gamma,
            1e-3,
            &statistics,
            true,
            sums.0,
            sums.1,
        );
    });
    (1e3 * forward, 1e3 * backward)
}

/// How the rows of a case are read.
#[derive(Clone, Copy)]
enum Reads {
    /// 3x3 on a map of columns and rows.
    Dense(usize, usize),
    /// 1x1 on such a map.
    Single(usize, usize),
    /// 27 taps on so many rows, of which a share is absent.
    Sparse(usize, f64),
}

/// What is read, channels in and out.
const CASES: [(Reads, usize, usize); 11] = [
    (Reads::Dense(200, 176), 96, 48),
    (Reads::Dense(200, 176), 48, 48),
    (Reads::Dense(100, 88), 96, 96),
    (Reads::Dense(200, 176), 128, 128),
    (Reads::Dense(100, 88), 256, 256),
    (Reads::Single(200, 176), 48, 64),
    (Reads::Single(200, 176), 128, 63),
    (Reads::Sparse(20_000, 0.8), 4, 16),
    (Reads::Sparse(20_000, 0.5), 16, 16),
    (Reads::Sparse(20_000, 0.5), 32, 32),
    (Reads::Sparse(20_000, 0.5), 48, 48),
];

/// Name, gather, input rows, channels in and out.
fn cases() -> impl Iterator<Item = (String, Gather, usize, usize, usize)> {
    CASES.into_iter().map(|(reads, cin, cout)| {
        let (name, gather, inputs) = match reads {
            Reads::Dense(w, h) => (format!("3x3 {w}x{h}"), dense(w, h), w * h),
            Reads::Single(w, h) => {
                let every = Gather::new(1, (0..(w * h) as u32).collect());
                (format!("1x1 {w}x{h}"), every, w * h)
            }
            Reads::Sparse(rows, off) => {
                let name = format!("27 taps {rows}, {:.0}% off", 100.0 * off);
                (name, sparse(rows, off), rows)
            }
        };
        (format!("{name} {cin}->{cout}"), gather, inputs, cin, cout)
    })
}

fn dense(width: usize, height: usize) -> Gather {
    let mut index = Vec::with_capacity(width * height * 9);
    for y in 0..height {
        for x in 0..width {
            for (dy, dx) in (0..9).map(|tap| (tap / 3, tap % 3)) {
                let (y, x) = (y + dy, x + dx);
                let inside = (1..=height).contains(&y) && (1..=width).contains(&x);
                index.push(if inside {
                    ((y - 1) * width + x - 1) as u32
                } else {
                    ABSENT
                });
            }
        }
    }
    Gather::new(9, index)
}

/// Neighbours near in memory, as in a sorted list of voxels, of which a share `off` is absent.
fn sparse(rows: usize, off: f64) -> Gather {
    let mut random = Random(7);
    let near = |row: usize, random: &mut Random| {
        ((row + rows + (random.unit() * 2000.0) as usize - 1000) % rows) as u32
    };
    let pick = |row: usize, random: &mut Random| {
        if random.unit() < off {
            ABSENT
        } else {
            near(row, random)
        }
    };
    Gather::new(
        27,
        (0..rows * 27).map(|i| pick(i / 27, &mut random)).collect(),
    )
}

/// GFLOP/s of the forward convolution in f32, bf16 and int8, and of the weight gradient; absent rows are not counted.
fn measure(
    level: Level,
    threads: usize,
    gather: &Gather,
    inputs: usize,
    cin: usize,
    cout: usize,
) -> [f64; 4] {
    let Ok(pool) = rayon::ThreadPoolBuilder::new().num_threads(threads).build() else {
        return [0.0; 4];
    };
    let mut random = Random(1);
    let mut values = |count: usize| {
        (0..count)
            .map(|_| random.unit() as f32 - 0.5)
            .collect::<Vec<_>>()
    };
    let input = values(inputs * cin);
    let plain = values(gather.taps * cin * cout);
    let mut output = values(gather.outputs() * cout);
    let (taps, relu) = (gather.taps, Epilogue::RELU);
    let weights = Weights::pack(taps, cin, cout, &plain);
    let forward = || convolve_at(level, &input, gather, &weights, relu, None, &mut output);
    let forward = best_seconds(&pool, forward);

    let weights = WeightsBf16::pack(taps, cin, cout, &plain);
    let short: Vec<Bf16> = input.iter().map(|&x| Bf16::from_f32(x)).collect();
    let mut short_output = vec![Bf16(0); output.len()];
    let out = &mut short_output;
    let bf16 = best_seconds(&pool, || {
        convolve_bf16_at(level, &short, gather, &weights, relu, None, out)
    });

    let weights = WeightsInt8::pack(taps, cin, cout, &plain);
    let bytes: Vec<u8> = input.iter().map(|x| (x * 500.0) as u8).collect();
    let mut byte_output = vec![0_u8; output.len()];
    let out = &mut byte_output;
    let int8 = best_seconds(&pool, || {
        convolve_int8_at(level, &bytes, gather, &weights, relu, None, out)
    });

    let mut gradient = vec![0.0; gather.taps * cin * cout];
    let backward = || weight_gradient_at(level, &input, cin, gather, &output, cout, &mut gradient);
    let backward = best_seconds(&pool, backward);

    let pairs = gather.index.iter().filter(|&&row| row != ABSENT).count();
    let gflop = 2e-9 * (pairs * cin * cout) as f64;
    [forward, bf16, int8, backward].map(|seconds| gflop / seconds)
}

fn best_seconds(pool: &rayon::ThreadPool, mut work: impl FnMut() + Send) -> f64 {
    pool.install(|| {
        let (mut best, begin) = (f64::INFINITY, Instant::now());
        let mut count = 0;
        while count < REPEATS || begin.elapsed().as_secs_f64() < SECONDS {
            let (start, on_core) = (Instant::now(), thread_seconds());
            work();
            best = best.min(match pool.current_num_threads() {
                1 => thread_seconds() - on_core,
                _ => start.elapsed().as_secs_f64(),
            });
            count += 1;
        }
        best
    })
}

/// Time of this thread on a core: others that want the core do not count.
fn thread_seconds() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// GFLOP/s of multiply-adds on registers alone; `spin` gives the operations of a run.
fn peak_gflops(spin: impl Fn() -> f64) -> f64 {
    let once = |_| {
        let start = thread_seconds();
        let flop = black_box(spin());
        1e-9 * flop / (thread_seconds() - start)
    };
    (0..REPEATS).map(once).fold(0.0, f64::max)
}

struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}
