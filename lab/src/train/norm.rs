//! Batch norm and ReLU over rows, the last of which may stand for many (see [`super::halo`]).
//!
//! Statistics are those of the dense map: a tail row counts as often as it stands for a cell. In the backward pass the
//! gradient of a tail row is the **sum** over its cells. Sums are taken over fixed chunks in a fixed order, so that the
//! result does not depend on the number of threads.

use mluc_kernels::{batch_norm_backward, batch_norm_forward};
use rayon::prelude::*;

/// Batch norm's epsilon in every layer (the public SECOND configurations).
pub const EPSILON: f32 = 1e-3;

/// Rows of a chunk of the reductions.
const CHUNK_ROWS: usize = 512;

/// The last rows of a map and how many cells each stands for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tail {
    /// How many of the last rows are weighted.
    pub rows: usize,
    /// Cells that each stands for; 0 takes the row out of the statistics.
    pub multiplicity: usize,
}

/// Mean and (biased) variance of each channel, and the cells counted.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Statistics {
    /// Per channel.
    pub mean: Vec<f32>,
    /// Per channel.
    pub variance: Vec<f32>,
    /// Cells.
    pub count: f64,
}

/// Scale and shift of a layer.
#[derive(Clone, Copy, Debug)]
pub struct Affine<'a> {
    /// Per channel.
    pub gamma: &'a [f32],
    /// Per channel.
    pub beta: &'a [f32],
}

impl Tail {
    /// The weight of the last row, where no more than one is weighted: the kernels' own batch norm does those.
    fn single(self) -> Option<f32> {
        match self.rows {
            0 => Some(1.0),
            1 => Some(self.multiplicity as f32),
            _ => None,
        }
    }

    /// Length of the part that counts once, and the weight of the rest.
    fn split(self, values: usize, channels: usize) -> (usize, f32) {
        (values - self.rows * channels, self.multiplicity as f32)
    }
}

/// Sums over weighted rows of `f(x, g)`, two per channel. `g` is a second map of the same shape.
fn reduce(
    x: &[f32],
    g: &[f32],
    channels: usize,
    tail: (usize, f32),
    f: impl Fn(&[f32], &[f32], &mut [f32], &mut [f32]) + Sync,
) -> (Vec<f64>, Vec<f64>) {
    let partial = |x: &[f32], g: &[f32]| {
        let mut sums = vec![0.0f32; 2 * channels];
        let (a, b) = sums.split_at_mut(channels);
        for (x, g) in x.chunks_exact(channels).zip(g.chunks_exact(channels)) {
            f(x, g, a, b);
        }
        sums
    };
    let (body, weight) = tail;
    let chunk = CHUNK_ROWS * channels;
    let parts: Vec<Vec<f32>> = x[..body]
        .par_chunks(chunk)
        .zip(g[..body].par_chunks(chunk))
        .map(|(x, g)| partial(x, g))
        .collect();
    let last = partial(&x[body..], &g[body..]);
    let mut total = vec![0.0f64; 2 * channels];
    for part in &parts {
        total
            .iter_mut()
            .zip(part)
            .for_each(|(t, p)| *t += f64::from(*p));
    }
    total
        .iter_mut()
        .zip(&last)
        .for_each(|(t, p)| *t += f64::from(weight) * f64::from(*p));
    let second = total.split_off(channels);
    (total, second)
}

/// [`statistics`] and [`normalise`] together: batch norm while training.
pub fn forward(x: &[f32], affine: Affine, tail: Tail, y: &mut [f32]) -> Statistics {
    let channels = affine.gamma.len();
    if let Some(weight) = tail.single() {
        let (gamma, beta) = (affine.gamma, affine.beta);
        let found = batch_norm_forward(x, channels, weight, gamma, beta, EPSILON, true, y);
        return Statistics {
            mean: found.mean,
            variance: found.var,
            count: found.count,
        };
    }
    let found = statistics(x, channels, tail);
    normalise(x, affine, &found, y);
    found
}

/// Mean and variance of each channel of `x` (rows of `channels`).
pub fn statistics(x: &[f32], channels: usize, tail: Tail) -> Statistics {
    let rows = x.len() / channels;
    let count = (rows - tail.rows + tail.rows * tail.multiplicity).max(1) as f64;
    let split = tail.split(x.len(), channels);
    let (sum, square) = reduce(x, x, channels, split, |x, _, sum, square| {
        for ((s, q), v) in sum.iter_mut().zip(square.iter_mut()).zip(x) {
            *s += v;
            *q += v * v;
        }
    });
    let mean: Vec<f64> = sum.iter().map(|s| s / count).collect();
    let variance = square
        .iter()
        .zip(&mean)
        .map(|(q, m)| (q / count - m * m).max(0.0) as f32);
    Statistics {
        variance: variance.collect(),
        mean: mean.iter().map(|m| *m as f32).collect(),
        count,
    }
}

/// `y = max(0, gamma * (x - mean) / sqrt(variance + eps) + beta)`.
pub fn normalise(x: &[f32], affine: Affine, statistics: &Statistics, y: &mut [f32]) {
    let channels = affine.gamma.len();
    let scale: Vec<f32> = affine
        .gamma
        .iter()
        .zip(&statistics.variance)
        .map(|(g, v)| g / (v + EPSILON).sqrt())
        .collect();
    let shift: Vec<f32> = affine
        .beta
        .iter()
        .zip(scale.iter().zip(&statistics.mean))
        .map(|(b, (s, m))| b - s * m)
        .collect();
    let chunk = CHUNK_ROWS * channels;
    y.par_chunks_mut(chunk)
        .zip(x.par_chunks(chunk))
        .for_each(|(y, x)| {
            for (y, x) in y.chunks_exact_mut(channels).zip(x.chunks_exact(channels)) {
                for (((y, x), a), b) in y.iter_mut().zip(x).zip(&scale).zip(&shift) {
                    *y = (a * x + b).max(0.0);
                }
            }
        });
}

/// Gradients of scale and shift.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AffineGradient {
    /// Per channel.
    pub gamma: Vec<f32>,
    /// Per channel.
    pub beta: Vec<f32>,
}

/// The gradient of [`forward`]: `gradient` enters as the gradient of `y` and leaves as
/// that of `x`.
pub fn backward(
    x: &[f32],
    y: &[f32],
    gradient: &mut [f32],
    gamma: &[f32],
    statistics: &Statistics,
    tail: Tail,
) -> AffineGradient {
    let channels = gamma.len();
    if let Some(weight) = tail.single() {
        let known = mluc_kernels::Statistics {
            mean: statistics.mean.clone(),
            var: statistics.variance.clone(),
            count: statistics.count,
        };
        let mut d = AffineGradient {
            gamma: vec![0.0; channels],
            beta: vec![0.0; channels],
        };
        let (dgamma, dbeta) = (&mut d.gamma, &mut d.beta);
        batch_norm_backward(
            x, y, gradient, channels, weight, gamma, EPSILON, &known, true, dgamma, dbeta,
        );
        return d;
    }
    let chunk = CHUNK_ROWS * channels;
    gradient
        .par_chunks_mut(chunk)
        .zip(y.par_chunks(chunk))
        .for_each(|(g, y)| {
            g.iter_mut()
                .zip(y)
                .for_each(|(g, y)| *g = if *y > 0.0 { *g } else { 0.0 });
        });
    let inverse: Vec<f32> = statistics
        .variance
        .iter()
        .map(|v| 1.0 / (v + EPSILON).sqrt())
        .collect();
    let mean = &statistics.mean;
    // Every row's gradient is already the sum over its cells, so each counts once.
    let (sum, product) = reduce(
        gradient,
        x,
        channels,
        (x.len(), 1.0),
        |g, x, sum, product| {
            for ((((s, p), g), x), m) in sum
                .iter_mut()
                .zip(product.iter_mut())
                .zip(g)
                .zip(x)
                .zip(mean)
            {
                *s += g;
                *p += g * (x - m);
            }
        },
    );
    let (body, weight) = tail.split(x.len(), channels);
    // dx = scale * (dy - weight * (mean(dy) + (x - mean) * mean(dy * (x - mean)) / variance'))
    let scale: Vec<f32> = gamma.iter().zip(&inverse).map(|(g, i)| g * i).collect();
    let constant: Vec<f32> = sum.iter().map(|s| (s / statistics.count) as f32).collect();
    let slope: Vec<f32> = product
        .iter()
        .zip(&inverse)
        .map(|(p, i)| (p / statistics.count) as f32 * i * i)
        .collect();
    let rows = |g: &mut [f32], x: &[f32], weight: f32| {
        for (g, x) in g.chunks_exact_mut(channels).zip(x.chunks_exact(channels)) {
            for c in 0..channels {
                let pull = constant[c] + (x[c] - mean[c]) * slope[c];
                g[c] = scale[c] * (g[c] - weight * pull);
            }
        }
    };
    let (head, last) = gradient.split_at_mut(body);
    head.par_chunks_mut(chunk)
        .zip(x[..body].par_chunks(chunk))
        .for_each(|(g, x)| rows(g, x, 1.0));
    rows(last, &x[body..], weight);
    AffineGradient {
        gamma: product
            .iter()
            .zip(&inverse)
            .map(|(p, i)| *p as f32 * i)
            .collect(),
        beta: sum.iter().map(|s| *s as f32).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::random::Random;

    /// A weighted tail gives what its copies written out give.
    #[test]
    fn a_tail_row_counts_as_its_copies() {
        (1..4).for_each(tail_rows_count_as_their_copies);
    }

    fn tail_rows_count_as_their_copies(tail_rows: usize) {
        let (channels, rows, copies) = (3, 700, 40);
        let mut random = Random::new(5, &[]);
        let mut draw = |n: usize| (0..n).map(|_| random.normal() as f32).collect::<Vec<_>>();
        let x = draw(rows * channels);
        let dy = draw(rows * channels);
        let (gamma, beta) = (vec![0.7, 1.1, -0.4], vec![0.1, -0.2, 0.3]);
        let affine = Affine {
            gamma: &gamma,
            beta: &beta,
        };
        let expand = |v: &[f32], share: f32| {
            let (body, last) = v.split_at((rows - tail_rows) * channels);
            let last: Vec<f32> = last.iter().map(|v| v * share).collect();
            [body, &last.repeat(copies)].concat()
        };
        let tail = Tail {
            rows: tail_rows,
            multiplicity: copies,
        };
        let run = |x: &[f32], mut g: Vec<f32>, tail: Tail| {
            let mut y = vec![0.0; x.len()];
            let s = forward(x, affine, tail, &mut y);
            let d = backward(x, &y, &mut g, &gamma, &s, tail);
            (s, g, d)
        };
        let (s, g, d) = run(&x, dy.clone(), tail);
        let (s2, g2, d2) = run(
            &expand(&x, 1.0),
            expand(&dy, 1.0 / copies as f32),
            Tail::default(),
        );
        let near = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 2e-5);
        assert_eq!(s.count, s2.count);
        assert!(near(&s.mean, &s2.mean) && near(&s.variance, &s2.variance));
        let body = (rows - tail_rows) * channels;
        assert!(near(&g[..body], &g2[..body]));
        let tail_values = tail_rows * channels;
        for v in 0..tail_values {
            let sum: f32 = g2[body..].iter().skip(v).step_by(tail_values).sum();
            assert!((sum - g[body + v]).abs() < 1e-5);
        }
        assert!(
            near(&d.beta, &d2.beta)
                && d.gamma
                    .iter()
                    .zip(&d2.gamma)
                    .all(|(a, b)| (a - b).abs() < 1e-3)
        );
    }
}
