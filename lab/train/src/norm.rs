//! Batch norm and ReLU over rows, the last of which may stand for many (see [`crate::halo`]).
//!
//! Statistics are those of the dense map: a tail row counts as often as it stands for a cell. In the backward pass the
//! gradient of a tail row is the **sum** over its cells. Sums are taken over fixed chunks in a fixed order, so that the
//! result does not depend on the number of threads.

use mluc_kernels::{BatchNorm, Statistics};
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

/// What a layer leaves for its backward pass.
#[derive(Clone, Debug, Default)]
pub struct Activation {
    /// Before batch norm.
    pub x: Vec<f32>,
    /// After ReLU.
    pub y: Vec<f32>,
    /// Used by batch norm.
    pub statistics: Statistics,
}

impl Tail {
    /// The kernels' own batch norm, where no more than one row is weighted.
    fn single<'a>(self, gamma: &'a [f32], beta: &'a [f32]) -> Option<BatchNorm<'a>> {
        let last_multiplicity = match self.rows {
            0 => 1.0,
            1 => self.multiplicity as f32,
            _ => return None,
        };
        Some(BatchNorm {
            gamma,
            beta,
            eps: EPSILON,
            relu: true,
            last_multiplicity,
        })
    }
}

/// Sums over rows of the two numbers of `f(x, g, m)`, by channel; the rows from value `body` on have a weight.
fn reduce(
    [x, g]: [&[f32]; 2],
    m: &[f32],
    (body, weight): (usize, usize),
    f: impl Fn(f32, f32, f32) -> [f32; 2] + Sync,
) -> [Vec<f64>; 2] {
    let channels = m.len();
    let partial = |x: &[f32], g: &[f32]| {
        let mut sums = [vec![0.0f32; channels], vec![0.0f32; channels]];
        let [a, b] = &mut sums;
        for (x, g) in x.chunks_exact(channels).zip(g.chunks_exact(channels)) {
            let sums = a.iter_mut().zip(b.iter_mut());
            for (((x, g), m), (a, b)) in x.iter().zip(g).zip(m).zip(sums) {
                let [first, second] = f(*x, *g, *m);
                *a += first;
                *b += second;
            }
        }
        sums
    };
    let chunk = CHUNK_ROWS * channels;
    let chunks = x[..body].par_chunks(chunk).zip(g[..body].par_chunks(chunk));
    let parts: Vec<_> = chunks.map(|(x, g)| partial(x, g)).collect();
    let last = partial(&x[body..], &g[body..]);
    [0, 1].map(|number| {
        let sum = |c: usize| {
            let body: f64 = parts.iter().map(|part| f64::from(part[number][c])).sum();
            body + weight as f64 * f64::from(last[number][c])
        };
        (0..channels).map(sum).collect()
    })
}

/// Batch norm while training: the statistics of `x`, and `y` by them. `affine`: scale and shift by channel.
pub fn forward(x: &[f32], affine: [&[f32]; 2], tail: Tail, y: &mut [f32]) -> Statistics {
    let channels = affine[0].len();
    if let Some(norm) = tail.single(affine[0], affine[1]) {
        return norm.forward(x, y);
    }
    let rows = x.len() / channels;
    let count = (rows - tail.rows + tail.rows * tail.multiplicity).max(1) as f64;
    let body = x.len() - tail.rows * channels;
    let weighted = (body, tail.multiplicity);
    let [sum, square] = reduce([x, x], affine[0], weighted, |v, _, _| [v, v * v]);
    let mean: Vec<f64> = sum.iter().map(|s| s / count).collect();
    let variance = |(q, m): (&f64, &f64)| (q / count - m * m).max(0.0) as f32;
    let statistics = Statistics {
        var: square.iter().zip(&mean).map(variance).collect(),
        mean: mean.iter().map(|m| *m as f32).collect(),
        count,
    };
    normalise(x, affine, &statistics, y);
    statistics
}

/// `y = max(0, gamma * (x - mean) / sqrt(variance + eps) + beta`.
pub fn normalise(x: &[f32], [gamma, beta]: [&[f32]; 2], statistics: &Statistics, y: &mut [f32]) {
    let channels = gamma.len();
    let Statistics { mean, var, .. } = statistics;
    let scale = gamma.iter().zip(var).map(|(g, v)| g / (v + EPSILON).sqrt());
    let scale: Vec<f32> = scale.collect();
    let shift: Vec<f32> = (0..channels)
        .map(|c| beta[c] - scale[c] * mean[c])
        .collect();
    let chunk = CHUNK_ROWS * channels;
    let chunks = y.par_chunks_mut(chunk).zip(x.par_chunks(chunk));
    chunks.for_each(|(y, x)| {
        for (y, x) in y.chunks_exact_mut(channels).zip(x.chunks_exact(channels)) {
            for (((y, x), a), b) in y.iter_mut().zip(x).zip(&scale).zip(&shift) {
                *y = (a * x + b).max(0.0);
            }
        }
    });
}

/// The gradient of [`forward`]: `gradient` enters as that of `y` and leaves as that of `x`; the gradients of scale and
/// shift are added to `affine`.
pub fn backward(
    Activation { x, y, statistics }: &Activation,
    tail: Tail,
    gamma: &[f32],
    gradient: &mut [f32],
    affine: (&mut [f32], &mut [f32]),
) {
    let channels = gamma.len();
    let (d_gamma, d_beta) = affine;
    // The shift has no part in its own gradient.
    if let Some(norm) = tail.single(gamma, gamma) {
        return norm.backward(x, y, gradient, statistics, d_gamma, d_beta);
    }
    let chunk = CHUNK_ROWS * channels;
    let chunks = gradient.par_chunks_mut(chunk).zip(y.par_chunks(chunk));
    chunks.for_each(|(g, y)| {
        let values = g.iter_mut().zip(y);
        values.for_each(|(g, y)| *g = if *y > 0.0 { *g } else { 0.0 });
    });
    let mean = &statistics.mean;
    // Every row's gradient is already the sum over its cells, so each counts once.
    let all = (x.len(), 1);
    let [sum, product] = reduce([gradient, x], mean, all, |g, x, m| [g, g * (x - m)]);
    let inverse = statistics.var.iter().map(|v| 1.0 / (v + EPSILON).sqrt());
    let inverse: Vec<f32> = inverse.collect();
    // dx = scale * (dy - weight * (mean(dy) + (x - mean) * mean(dy * (x - mean)) / variance'))
    let share = |sum: f64| (sum / statistics.count) as f32;
    let of_channel = |c: usize| {
        let i = inverse[c];
        let slope = share(product[c]) * i * i;
        [gamma[c] * i, share(sum[c]), mean[c], slope]
    };
    let terms: Vec<[f32; 4]> = (0..channels).map(of_channel).collect();
    let rows = |g: &mut [f32], x: &[f32], weight: f32| {
        for (g, x) in g.chunks_exact_mut(channels).zip(x.chunks_exact(channels)) {
            for ((g, x), [scale, constant, mean, slope]) in g.iter_mut().zip(x).zip(&terms) {
                let mean_part = constant + (x - mean) * slope;
                *g = scale * (*g - weight * mean_part);
            }
        }
    };
    let body = x.len() - tail.rows * channels;
    let (head, last) = gradient.split_at_mut(body);
    let chunks = head.par_chunks_mut(chunk).zip(x[..body].par_chunks(chunk));
    chunks.for_each(|(g, x)| rows(g, x, 1.0));
    rows(last, &x[body..], tail.multiplicity as f32);
    for c in 0..channels {
        d_gamma[c] += product[c] as f32 * inverse[c];
        d_beta[c] += sum[c] as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_geometry::Random;

    /// A weighted tail gives what its copies written out give.
    #[test]
    fn a_tail_row_counts_as_its_copies() {
        let (channels, rows, copies) = (3, 700, 40);
        let mut random = Random::new(5, &[]);
        let mut draw = |n: usize| -> Vec<f32> { (0..n).map(|_| random.normal() as f32).collect() };
        let (x, dy) = (draw(rows * channels), draw(rows * channels));
        let affine: [&[f32]; 2] = [&[0.7, 1.1, -0.4], &[0.1, -0.2, 0.3]];
        let run = |x: Vec<f32>, mut g: Vec<f32>, tail: Tail| {
            let mut y = vec![0.0; x.len()];
            let statistics = forward(&x, affine, tail, &mut y);
            let activation = Activation { x, y, statistics };
            let (mut d_gamma, mut d_beta) = (vec![0.0; channels], vec![0.0; channels]);
            let sums = (&mut d_gamma[..], &mut d_beta[..]);
            backward(&activation, tail, affine[0], &mut g, sums);
            (activation.statistics, g, d_gamma, d_beta)
        };
        let near = |a: &[f32], b: &[f32], most: f32| {
            let mut pairs = a.iter().zip(b);
            assert!(pairs.all(|(a, b)| (a - b).abs() < most), "{a:?} {b:?}");
        };
        for tail_rows in 1..4 {
            let body = (rows - tail_rows) * channels;
            let expand = |v: &[f32], share: f32| {
                let (body, last) = v.split_at(body);
                let last: Vec<f32> = last.iter().map(|v| v * share).collect();
                [body, &last.repeat(copies)].concat()
            };
            let tail = Tail {
                rows: tail_rows,
                multiplicity: copies,
            };
            let (s, g, gamma, beta) = run(x.clone(), dy.clone(), tail);
            let written_out = (expand(&x, 1.0), expand(&dy, 1.0 / copies as f32));
            let (s2, g2, gamma2, beta2) = run(written_out.0, written_out.1, Tail::default());
            assert_eq!(s.count, s2.count);
            near(&s.mean, &s2.mean, 2e-5);
            near(&s.var, &s2.var, 2e-5);
            near(&g[..body], &g2[..body], 2e-5);
            near(&beta, &beta2, 2e-5);
            near(&gamma, &gamma2, 1e-3);
            let tail_values = tail_rows * channels;
            for v in 0..tail_values {
                let sum: f32 = g2[body..].iter().skip(v).step_by(tail_values).sum();
                assert!((sum - g[body + v]).abs() < 1e-5);
            }
        }
    }
}
