//! The plain reference that every faster version is compared with, and random cases.
#![allow(dead_code)] // Each test file uses a part of it.

use mluc_kernels::{ABSENT, Bf16, Element, Gather};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// A linear congruential generator: it gives the same cases on every machine.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn below(&mut self, bound: usize) -> usize {
        let product = self.0.wrapping_mul(6_364_136_223_846_793_005);
        self.0 = product.wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % bound
    }

    /// Values from -0.5 to 0.5.
    pub(crate) fn values(&mut self, count: usize) -> Vec<f32> {
        let mut value = || self.below(1 << 20) as f32 / (1 << 20) as f32 - 0.5;
        (0..count).map(|_| value()).collect()
    }

    /// `absent_percent` of the entries are [`ABSENT`].
    pub(crate) fn gather(
        &mut self,
        outputs: usize,
        taps: usize,
        inputs: usize,
        absent_percent: usize,
    ) -> Gather {
        let mut entry = || {
            if inputs == 0 || self.below(100) < absent_percent {
                return ABSENT;
            }
            self.below(inputs) as u32
        };
        Gather::new(taps, (0..outputs * taps).map(|_| entry()).collect())
    }
}

/// Inputs of a convolution whose products are exact: only the sums are rounded.
pub(crate) trait Input: Element + PartialEq + std::fmt::Debug {
    const TOLERANCE: f64 = 4e-6;

    fn inputs(random: &mut Random, count: usize) -> Vec<Self> {
        random.values(count).into_iter().map(Self::from_f32).collect()
    }

    /// The first `cout` weights are those that set the scale of each output channel.
    fn weights(random: &mut Random, count: usize, _cout: usize) -> Vec<f32> {
        Self::inputs(random, count).into_iter().map(Self::to_f32).collect()
    }

    fn bias(random: &mut Random, cout: usize) -> Vec<f32> {
        random.values(cout)
    }

    fn value(sum: f64, bias: f32) -> f64 {
        sum + f64::from(bias)
    }
}

impl Input for f32 {}

impl Input for Bf16 {}

macro_rules! counts {
    ($($type:ty),*) => {$(
        /// The bits must be equal. Extreme values are frequent, so that a saturating product of bytes would be noticed.
        impl Input for $type {
            const TOLERANCE: f64 = 0.0;

            fn inputs(random: &mut Random, count: usize) -> Vec<$type> {
                let mut byte = || [0, 255, 255, random.below(256)][random.below(4)] as $type;
                (0..count).map(|_| byte()).collect()
            }

            /// Whole numbers up to 127. Each output channel has a 127, so its scale is 1.
            fn weights(random: &mut Random, count: usize, cout: usize) -> Vec<f32> {
                let mut weight = || {
                    let any = random.below(255) as i32 - 127;
                    [127, -127, any, any][random.below(4)] as f32
                };
                let mut weights: Vec<f32> = (0..count).map(|_| weight()).collect();
                weights[..cout].fill(127.0);
                weights
            }

            fn bias(random: &mut Random, cout: usize) -> Vec<f32> {
                let whole = |value: &f32| (value * 1e6).round();
                random.values(cout).iter().map(whole).collect()
            }

            /// Rounded once, like an i32 that becomes an f32, and once more with the bias.
            fn value(sum: f64, bias: f32) -> f64 {
                f64::from(sum as f32 + bias)
            }
        }
    )*};
}
counts!(u8, i16);

/// A map of `width x height` read by a 3x3 kernel; each (input row, tap) is read at most once.
pub(crate) fn dense(width: usize, height: usize) -> Gather {
    let entry = |(cell, tap): (usize, usize)| {
        let (y, x) = (cell / width + tap / 3, cell % width + tap % 3);
        let inside = (1..=height).contains(&y) && (1..=width).contains(&x);
        let index = || ((y - 1) * width + x - 1) as u32;
        inside.then(index).unwrap_or(ABSENT)
    };
    let cells = (0..width * height).flat_map(|cell| (0..9).map(move |tap| (cell, tap)));
    Gather::new(9, cells.map(entry).collect())
}

/// Calls `product` for each output row with the number of a row of the weights (`[tap][cin]`) and the input that it is multiplied by.
fn each_product(
    input: &[f32],
    cin: usize,
    gather: &Gather,
    mut product: impl FnMut(usize, usize, f64),
) {
    let rows = gather.index.iter().enumerate();
    for (at, row) in rows.filter(|(_, row)| **row != ABSENT) {
        let (output, tap) = (at / gather.taps, at % gather.taps);
        for (i, x) in input[*row as usize * cin..][..cin].iter().enumerate() {
            product(output, tap * cin + i, f64::from(*x));
        }
    }
}

/// `to += x * from`.
fn add(to: &mut [f64], x: f64, from: &[f32]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to += x * f64::from(*from);
    }
}

/// Convolution with `[tap][cin][cout]` weights; sums in f64, one row of `cout` for each output row.
pub(crate) fn convolve(
    input: &[f32],
    cin: usize,
    gather: &Gather,
    weights: &[f32],
    cout: usize,
) -> Vec<f64> {
    let mut output = vec![0.0; gather.outputs() * cout];
    each_product(input, cin, gather, |row, weight, x| {
        let to = &mut output[row * cout..][..cout];
        add(to, x, &weights[weight * cout..]);
    });
    output
}

/// The gradient of the weights, `[tap][cin][cout]`, in f64.
pub(crate) fn weight_gradient(
    input: &[f32],
    cin: usize,
    gather: &Gather,
    dy: &[f32],
    cout: usize,
) -> Vec<f64> {
    let mut gradient = vec![0.0; gather.taps * cin * cout];
    each_product(input, cin, gather, |row, weight, x| {
        add(&mut gradient[weight * cout..][..cout], x, &dy[row * cout..]);
    });
    gradient
}

/// Panics unless each value is within `tolerance * (1 + largest expected)`.
pub(crate) fn assert_near(found: &[f32], expected: &[f64], tolerance: f64, what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let largest = expected.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    let scale = 1.0 + largest;
    for (i, (found, expected)) in found.iter().zip(expected).enumerate() {
        let off = (f64::from(*found) - expected).abs();
        assert!(off <= tolerance * scale, "{what}: value {i} is {found}, expected {expected}");
    }
}

/// Panics unless `work` panics with a message that contains `expected`.
pub(crate) fn assert_refused<R>(expected: &str, work: impl FnOnce() -> R) {
    let panicked = catch_unwind(AssertUnwindSafe(work)).err().expect("a panic");
    let text = panicked.downcast_ref::<&str>().copied();
    let text = text.or(panicked.downcast_ref::<String>().map(String::as_str));
    assert!(text.is_some_and(|text| text.contains(expected)), "{text:?}");
}

/// Runs `work` on its own pool.
pub(crate) fn with_threads<R: Send>(threads: usize, work: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool").install(work)
}
