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

/// `y = gamma * (x - mean) / sqrt(var + eps) + beta`, then max(0, y) when `relu`; mean and variance are those of `x`.
///
/// `x`, `y`: rows of `channels`; the last row counts `last_multiplicity` (>= 0) times. `gamma`, `beta`: `channels`.
///
/// # Panics
/// When lengths contradict each other (a broken invariant, not data).
pub fn batch_norm_forward(
    x: &[f32],
    channels: usize,
    last_multiplicity: f32,
    gamma: &[f32],
    beta: &[f32],
    eps: f32,
    relu: bool,
    y: &mut [f32],
) -> Statistics {
    assert!(
        channels > 0 && x.len().is_multiple_of(channels),
        "{} values in rows of {channels}",
        x.len()
    );
    assert!(
        gamma.len() == channels && beta.len() == channels,
        "a gamma and a beta for each of {channels} channels"
    );
    assert_eq!(y.len(), x.len());
    let level = Level::best();
    let statistics = statistics(level, x, channels, last_multiplicity);
    let scale: Vec<f32> = statistics
        .inverse_deviation(eps)
        .zip(gamma)
        .map(|(r, &gamma)| (r * f64::from(gamma)) as f32)
        .collect();
    let task = TASK_ROWS * channels;
    y.par_chunks_mut(task)
        .zip(x.par_chunks(task))
        .for_each(|(y, x)| {
            level.run(Normalise {
                x,
                y,
                mean: &statistics.mean,
                scale: &scale,
                beta,
                relu,
            });
        });
    statistics
}

/// The gradient of [`batch_norm_forward`].
///
/// `x`, `y`: its input and output. `dy` holds the gradient of `y` on entry and that of `x` on return; in both the last
/// row holds the sum over its `last_multiplicity` cells. The gradients of gamma and beta are added to `dgamma`, `dbeta`.
///
/// # Panics
/// When lengths contradict each other (a broken invariant, not data).
pub fn batch_norm_backward(
    x: &[f32],
    y: &[f32],
    dy: &mut [f32],
    channels: usize,
    last_multiplicity: f32,
    gamma: &[f32],
    eps: f32,
    statistics: &Statistics,
    relu: bool,
    dgamma: &mut [f32],
    dbeta: &mut [f32],
) {
    assert!(
        channels > 0 && x.len().is_multiple_of(channels),
        "{} values in rows of {channels}",
        x.len()
    );
    assert!(y.len() == x.len() && dy.len() == x.len());
    let by_channel = [
        gamma.len(),
        dgamma.len(),
        dbeta.len(),
        statistics.mean.len(),
        statistics.var.len(),
    ];
    assert_eq!(by_channel, [channels; 5], "a value for each channel");
    if x.is_empty() {
        return;
    }
    let level = Level::best();
    let sums = gradient_sums(level, x, y, dy, &statistics.mean, relu);
    let mut slope = Slope {
        gain: vec![0.0; channels],
        mean: vec![0.0; channels],
        slant: vec![0.0; channels],
    };
    for (c, r) in statistics.inverse_deviation(eps).enumerate() {
        let (sum, sum_xhat) = (sums[c], sums[channels + c] * r);
        dbeta[c] += sum as f32;
        dgamma[c] += sum_xhat as f32;
        let gain = f64::from(gamma[c]) * r;
        slope.gain[c] = gain as f32;
        slope.mean[c] = (gain * sum / statistics.count) as f32;
        slope.slant[c] = (gain * r * sum_xhat / statistics.count) as f32;
    }
    let last = x.len() - channels;
    let task = TASK_ROWS * channels;
    let (ordinary, last_dy) = dy.split_at_mut(last);
    let run = |x, y, dy, multiplicity| {
        level.run(Differentiate {
            x,
            y,
            dy,
            mean: &statistics.mean,
            slope: &slope,
            multiplicity,
            relu,
        });
    };
    let rows = x[..last].par_chunks(task).zip(y[..last].par_chunks(task));
    ordinary
        .par_chunks_mut(task)
        .zip(rows)
        .for_each(|(dy, (x, y))| run(x, y, dy, 1.0));
    run(&x[last..], &y[last..], last_dy, last_multiplicity);
}

/// Mean and biased variance; the last row counts `last_multiplicity` times.
fn statistics(level: Level, x: &[f32], channels: usize, last_multiplicity: f32) -> Statistics {
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
    let mut sums = vec![0.0; 2 * channels];
    let part = part_rows(rows) * channels;
    let parts: Vec<_> = ordinary
        .par_chunks(part)
        .map(|x| level.run(Moments { x, channels }))
        .collect();
    parts.iter().for_each(|part| add(&mut sums, part));
    let multiplicity = f64::from(last_multiplicity);
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

/// Sums over the rows of dy, then of dy * (x - mean), for each channel.
fn gradient_sums(
    level: Level,
    x: &[f32],
    y: &[f32],
    dy: &[f32],
    mean: &[f32],
    relu: bool,
) -> Vec<f64> {
    let channels = mean.len();
    let part = part_rows(x.len() / channels) * channels;
    let rows = x
        .par_chunks(part)
        .zip(y.par_chunks(part))
        .zip(dy.par_chunks(part));
    let parts: Vec<_> = rows
        .map(|((x, y), dy)| {
            level.run(Products {
                x,
                y,
                dy,
                mean,
                relu,
            })
        })
        .collect();
    let mut sums = vec![0.0; 2 * channels];
    parts.iter().for_each(|part| add(&mut sums, part));
    sums
}

fn part_rows(rows: usize) -> usize {
    rows.div_ceil(PARTS_MAX).max(PART_ROWS_MIN)
}

fn add(sums: &mut [f64], part: &[f64]) {
    sums.iter_mut()
        .zip(part)
        .for_each(|(sum, part)| *sum += part);
}
