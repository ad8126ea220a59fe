//! Batch normalisation for training, with the ReLU that follows it (Ioffe and Szegedy, arXiv 1502.03167).
//!
//! A map is computed where it can differ from an empty scene; one **last row** stands for all the other cells, which are
//! equal. It counts `last_multiplicity` times in the statistics, and its gradient is the sum over the cells that it
//! stands for. With a multiplicity of 1 it is a row like any other.
//!
//! Sums are in f64, over parts that the number of rows alone decides, added in order: the bits do not depend on the
//! number of threads.

mod passes;

use rayon::prelude::*;

use crate::simd::Level;
use passes::{Differentiate, Moments, Normalise, Products, Slope};

/// Most parts of a sum.
const PARTS_MAX: usize = 32;
/// Fewest rows of a part.
const PART_ROWS_MIN: usize = 256;
/// Rows that one task of an elementwise pass works on.
const TASK_ROWS: usize = 512;

/// Statistics of each channel over a batch.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Statistics {
    /// Mean of each channel.
    pub mean: Vec<f32>,
    /// Biased variance of each channel; times `count / (count - 1)` it is the unbiased one.
    pub var: Vec<f32>,
    /// Rows, the last one counted with its multiplicity.
    pub count: f64,
}

impl Statistics {
    /// 1 / sqrt(var + eps) of each channel.
    fn inverse_deviation(&self, eps: f32) -> impl Iterator<Item = f64> {
        self.var
            .iter()
            .map(move |&var| 1.0 / (f64::from(var) + f64::from(eps)).sqrt())
    }
}

/// A normalisation: `y = gamma * (x - mean) / sqrt(var + eps) + beta`, then max(0, y) when `relu`.
///
/// `x`, `y` and their gradients are rows with a value for each channel.
#[derive(Clone, Copy, Debug)]
pub struct BatchNorm<'a> {
    /// Scale of each channel.
    pub gamma: &'a [f32],
    /// Shift of each channel.
    pub beta: &'a [f32],
    /// Added to the variance.
    pub eps: f32,
    /// Whether a ReLU follows.
    pub relu: bool,
    /// How often the last row counts; at least 0.
    pub last_multiplicity: f32,
}

impl BatchNorm<'_> {
    /// `y` by the mean and variance of `x`, which are returned.
    ///
    /// # Panics
    /// When lengths contradict each other (a broken invariant, not data).
    pub fn forward(&self, x: &[f32], y: &mut [f32]) -> Statistics {
        let channels = self.check(x, [y.len(), x.len()]);
        let level = Level::best();
        let statistics = self.statistics(level, x);
        let inverse = statistics.inverse_deviation(self.eps).zip(self.gamma);
        let scale: Vec<f32> = inverse.map(|(r, g)| (r * f64::from(*g)) as f32).collect();
        let task = TASK_ROWS * channels;
        let tasks = y.par_chunks_mut(task).zip(x.par_chunks(task));
        tasks.for_each(|(y, x)| {
            level.run(Normalise {
                x,
                y,
                mean: &statistics.mean,
                scale: &scale,
                beta: self.beta,
                relu: self.relu,
            });
        });
        statistics
    }

    /// The gradient of [`BatchNorm::forward`].
    ///
    /// `x`, `y`: its input and output. `dy` holds the gradient of `y` on entry and that of `x` on return; in both the last
    /// row holds the sum over its cells. The gradients of gamma and beta are added to `dgamma`, `dbeta`.
    ///
    /// # Panics
    /// When lengths contradict each other (a broken invariant, not data).
    pub fn backward(
        &self,
        x: &[f32],
        y: &[f32],
        dy: &mut [f32],
        statistics: &Statistics,
        dgamma: &mut [f32],
        dbeta: &mut [f32],
    ) {
        let channels = self.check(x, [y.len(), dy.len()]);
        let Statistics { mean, var, count } = statistics;
        let by_channel = [dgamma.len(), dbeta.len(), mean.len(), var.len()];
        assert_eq!(by_channel, [channels; 4], "a value for each channel");
        if x.is_empty() {
            return;
        }
        let (level, relu) = (Level::best(), self.relu);
        let part = part_rows(x.len() / channels) * channels;
        let rows = x.par_chunks(part).zip(y.par_chunks(part));
        let products = rows.zip(dy.par_chunks(part)).map(|((x, y), dy)| {
            level.run(Products {
                x,
                y,
                dy,
                mean,
                relu,
            })
        });
        let sums = added(products.collect(), channels);
        let mut slope = Slope {
            gain: vec![0.0; channels],
            mean: vec![0.0; channels],
            slant: vec![0.0; channels],
        };
        for (c, r) in statistics.inverse_deviation(self.eps).enumerate() {
            let (sum, sum_xhat) = (sums[c], sums[channels + c] * r);
            dbeta[c] += sum as f32;
            dgamma[c] += sum_xhat as f32;
            let gain = f64::from(self.gamma[c]) * r;
            slope.gain[c] = gain as f32;
            slope.mean[c] = (gain * sum / count) as f32;
            slope.slant[c] = (gain * r * sum_xhat / count) as f32;
        }
        let run = |x, y, dy, multiplicity| {
            level.run(Differentiate {
                x,
                y,
                dy,
                mean,
                slope: &slope,
                multiplicity,
                relu,
            });
        };
        let (last, task) = (x.len() - channels, TASK_ROWS * channels);
        let (ordinary, last_dy) = dy.split_at_mut(last);
        let rows = x[..last].par_chunks(task).zip(y[..last].par_chunks(task));
        let tasks = ordinary.par_chunks_mut(task).zip(rows);
        tasks.for_each(|(dy, (x, y))| run(x, y, dy, 1.0));
        run(&x[last..], &y[last..], last_dy, self.last_multiplicity);
    }

    /// The channels. Panics when `x` or what has `lengths` is not of its rows.
    fn check(&self, x: &[f32], lengths: [usize; 2]) -> usize {
        let channels = self.gamma.len();
        assert_eq!(self.beta.len(), channels, "a gamma and a beta a channel");
        let whole = channels > 0 && x.len().is_multiple_of(channels);
        assert!(whole, "{} values in rows of {channels}", x.len());
        assert_eq!(lengths, [x.len(); 2], "as many values as of x");
        channels
    }

    /// Mean and biased variance; the last row counts `last_multiplicity` times.
    fn statistics(&self, level: Level, x: &[f32]) -> Statistics {
        let channels = self.gamma.len();
        let rows = x.len() / channels;
        let mut statistics = Statistics {
            mean: vec![0.0; channels],
            var: vec![0.0; channels],
            count: 0.0,
        };
        if rows == 0 {
            return statistics;
        }
        let (ordinary, last) = x.split_at(x.len() - channels);
        let parts = ordinary.par_chunks(part_rows(rows) * channels);
        let parts = parts.map(|x| level.run(Moments { x, channels }));
        let sums = added(parts.collect(), channels);
        let multiplicity = f64::from(self.last_multiplicity);
        statistics.count = (rows - 1) as f64 + multiplicity;
        for (c, &x) in last.iter().enumerate().filter(|_| statistics.count > 0.0) {
            let x = f64::from(x);
            let mean = (sums[c] + multiplicity * x) / statistics.count;
            let square = (sums[channels + c] + multiplicity * x * x) / statistics.count;
            statistics.mean[c] = mean as f32;
            statistics.var[c] = (square - mean * mean).max(0.0) as f32;
        }
        statistics
    }
}

fn part_rows(rows: usize) -> usize {
    rows.div_ceil(PARTS_MAX).max(PART_ROWS_MIN)
}

/// Two sums a channel, over the parts in order.
fn added(parts: Vec<Vec<f64>>, channels: usize) -> Vec<f64> {
    let mut sums = vec![0.0; 2 * channels];
    for part in parts {
        let pairs = sums.iter_mut().zip(part);
        pairs.for_each(|(sum, part)| *sum += part);
    }
    sums
}
