//! The plain version that every faster one is compared with, and random cases.
#![allow(dead_code)] // Each test file uses a part of it.

use mluc_kernels::{ABSENT, Epilogue, Gather};

/// A linear congruential generator: the same cases on every machine.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn below(&mut self, bound: usize) -> usize {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % bound
    }

    /// -0.5 to 0.5.
    pub(crate) fn values(&mut self, count: usize) -> Vec<f32> {
        (0..count)
            .map(|_| self.below(1 << 20) as f32 / (1 << 20) as f32 - 0.5)
            .collect()
    }

    /// `absent_percent` of the entries are [`ABSENT`].
    pub(crate) fn gather(
        &mut self,
        outputs: usize,
        taps: usize,
        inputs: usize,
        absent_percent: usize,
    ) -> Gather {
        let absent = |random: &mut Random| inputs == 0 || random.below(100) < absent_percent;
        let index = (0..outputs * taps).map(|_| {
            if absent(self) {
                ABSENT
            } else {
                self.below(inputs) as u32
            }
        });
        Gather::new(taps, index.collect())
    }

    /// 0..count in random order.
    pub(crate) fn permutation(&mut self, count: usize) -> Vec<u32> {
        let mut rows: Vec<u32> = (0..count as u32).collect();
        (1..count).for_each(|i| rows.swap(i, self.below(i + 1)));
        rows
    }
}

/// `[tap][cin][cout]` weights; sums in f64, one row of `cout` for each output row.
pub(crate) fn convolve(
    input: &[f32],
    cin: usize,
    gather: &Gather,
    weights: &[f32],
    cout: usize,
    epilogue: Epilogue,
) -> Vec<f64> {
    let mut output = vec![0.0; gather.outputs() * cout];
    for (o, out) in output.chunks_exact_mut(cout).enumerate() {
        for (channel, out) in out.iter_mut().enumerate() {
            let mut sum = epilogue.bias.map_or(0.0, |bias| f64::from(bias[channel]));
            for tap in 0..gather.taps {
                let row = gather.index[o * gather.taps + tap];
                for i in (0..cin).filter(|_| row != ABSENT) {
                    sum += f64::from(input[row as usize * cin + i])
                        * f64::from(weights[(tap * cin + i) * cout + channel]);
                }
            }
            *out = if epilogue.relu { sum.max(0.0) } else { sum };
        }
    }
    output
}

/// `[tap][cin][cout]`, in f64.
pub(crate) fn weight_gradient(
    input: &[f32],
    cin: usize,
    gather: &Gather,
    dy: &[f32],
    cout: usize,
) -> Vec<f64> {
    let mut gradient = vec![0.0; gather.taps * cin * cout];
    for o in 0..gather.outputs() {
        for tap in 0..gather.taps {
            let row = gather.index[o * gather.taps + tap];
            for i in (0..cin).filter(|_| row != ABSENT) {
                for channel in 0..cout {
                    gradient[(tap * cin + i) * cout + channel] +=
                        f64::from(input[row as usize * cin + i])
                            * f64::from(dy[o * cout + channel]);
                }
            }
        }
    }
    gradient
}

/// Panics unless each value is within `tolerance * (1 + largest expected)`.
pub(crate) fn assert_near(found: &[f32], expected: &[f64], tolerance: f64, what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let scale = 1.0
        + expected
            .iter()
            .fold(0.0_f64, |largest, x| largest.max(x.abs()));
    for (i, (found, expected)) in found.iter().zip(expected).enumerate() {
        let off = (f64::from(*found) - expected).abs();
        assert!(
            off <= tolerance * scale,
            "{what}: value {i} is {found}, expected {expected}"
        );
    }
}

/// Runs `work` on a pool of its own.
pub(crate) fn with_threads<R: Send>(threads: usize, work: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .expect("a pool")
        .install(work)
}
