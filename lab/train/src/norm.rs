//! Batch norm (Ioffe and Szegedy, arXiv 1502.03167) and ReLU over rows, the last of which may represent many cells (see [`crate::halo`]).
//!
//! Statistics are those of the dense map: a tail row counts once for each of its cells. In the backward pass the
//! gradient of a tail row is the **sum** over its cells. Sums, in f64, are taken over parts that depend only on the number of
//! rows, added in order, so that the result does not depend on the number of threads.

use mluc_kernels::at_best;
use rayon::prelude::*;

/// Batch norm's epsilon in every layer (the public SECOND configurations).
pub const EPSILON: f32 = 1e-3;

const CHUNK_ROWS: usize = 512;
/// Maximum number of parts of a sum.
const PARTS_MAX: usize = 32;
/// Minimum number of rows of such a part.
const PART_ROWS_MIN: usize = 256;

/// The last rows of a map and the number of cells that each represents.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tail {
    /// Number of last rows with a weight.
    pub rows: usize,
    /// Number of cells per row; 0 excludes the row from the statistics.
    pub multiplicity: usize,
}

/// Statistics of each channel over a batch.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Statistics {
    /// Mean of each channel.
    pub mean: Vec<f32>,
    /// Biased variance of each channel; times `count / (count - 1)` it is the unbiased one.
    pub var: Vec<f32>,
    /// Number of rows, with tail rows counted by their multiplicity.
    pub count: f64,
}

/// Results of a layer for its backward pass.
#[derive(Clone, Debug, Default)]
pub struct Activation {
    /// Values before batch norm.
    pub x: Vec<f32>,
    /// Values after ReLU.
    pub y: Vec<f32>,
    /// Statistics used by batch norm.
    pub statistics: Statistics,
}

impl Tail {
    /// The tail for a map of `rows` rows; the last row is always separate.
    fn of(self, rows: usize) -> Tail {
        let last = Tail { rows: rows.min(1), multiplicity: 1 };
        if self.rows == 0 { last } else { self }
    }
}

/// Sums of the two numbers of `f(x, g, m)` over rows, by channel; the rows from value `body` on have a weight.
fn reduce(
    [x, g]: [&[f32]; 2],
    m: &[f32],
    (body, weight): (usize, usize),
    f: impl Fn(f32, f32, f32) -> [f64; 2] + Sync,
) -> [Vec<f64>; 2] {
    let channels = m.len();
    let add_rows = |x: &[f32], g: &[f32]| {
        let mut sums = [(); 2].map(|()| vec![0.0; channels]);
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
    let partial = |x: &[f32], g: &[f32]| at_best(|| add_rows(x, g));
    let rows = x.len() / channels;
    let part = rows.div_ceil(PARTS_MAX).max(PART_ROWS_MIN) * channels;
    let chunks = x[..body].par_chunks(part).zip(g[..body].par_chunks(part));
    let parts: Vec<_> = chunks.map(|(x, g)| partial(x, g)).collect();
    let last = partial(&x[body..], &g[body..]);
    [0, 1].map(|number| {
        let sum = |c: usize| {
            parts.iter().map(|part| part[number][c]).sum::<f64>() + weight as f64 * last[number][c]
        };
        (0..channels).map(sum).collect()
    })
}

/// Batch norm in training: the statistics of `x`, and the `y` that they give. `affine`: scale and shift by channel.
pub fn forward(x: &[f32], affine: [&[f32]; 2], tail: Tail, y: &mut [f32]) -> Statistics {
    let [gamma, _] = affine;
    let channels = gamma.len();
    let rows = x.len() / channels;
    let tail = tail.of(rows);
    let weighted = (x.len() - tail.rows * channels, tail.multiplicity);
    let powers = |v: f32, _, _| [f64::from(v), f64::from(v) * f64::from(v)];
    let [sum, square] = reduce([x, x], gamma, weighted, powers);
    let count = (rows - tail.rows + tail.rows * tail.multiplicity) as f64;
    let mean: Vec<f64> = sum.iter().map(|s| s / count.max(1.0)).collect();
    let variance = |(q, m): (&f64, &f64)| (q / count.max(1.0) - m * m).max(0.0) as f32;
    let statistics = Statistics {
        var: square.iter().zip(&mean).map(variance).collect(),
        mean: mean.iter().map(|m| *m as f32).collect(),
        count,
    };
    normalise(x, affine, &statistics, y);
    statistics
}

fn inverse_deviation(var: f32) -> f64 {
    1.0 / (f64::from(var) + f64::from(EPSILON)).sqrt()
}

/// `y = max(0, gamma * (x - mean) / sqrt(variance + eps) + beta`; NaN stays NaN.
pub fn normalise(x: &[f32], [gamma, beta]: [&[f32]; 2], statistics: &Statistics, y: &mut [f32]) {
    let Statistics { mean, var, .. } = statistics;
    let channels = gamma.len();
    let scale = gamma.iter().zip(var);
    let scale = scale.map(|(g, var)| (inverse_deviation(*var) * f64::from(*g)) as f32);
    let scale: Vec<f32> = scale.collect();
    let work = |y: &mut [f32], x: &[f32]| {
        for (y, x) in y.chunks_exact_mut(channels).zip(x.chunks_exact(channels)) {
            let values = x.iter().zip(mean).zip(scale.iter().zip(beta));
            for (y, ((x, mean), (scale, beta))) in y.iter_mut().zip(values) {
                let value = (x - mean) * scale + beta;
                *y = if value < 0.0 { 0.0 } else { value };
            }
        }
    };
    let chunk = CHUNK_ROWS * channels;
    y.par_chunks_mut(chunk).zip(x.par_chunks(chunk)).for_each(|(y, x)| at_best(|| work(y, x)));
}

/// The gradient of [`forward`]: `gradient` is that of `y` on entry and that of `x` on return; the gradients of scale and shift are added to `affine`.
pub fn backward(
    Activation { x, y, statistics }: &Activation,
    tail: Tail,
    gamma: &[f32],
    gradient: &mut [f32],
    (d_gamma, d_beta): (&mut [f32], &mut [f32]),
) {
    let channels = gamma.len();
    let (rows, chunk) = (x.len() / channels, CHUNK_ROWS * channels);
    let chunks = gradient.par_chunks_mut(chunk).zip(y.par_chunks(chunk));
    chunks.for_each(|(g, y)| {
        g.iter_mut().zip(y).for_each(|(g, y)| *g = if *y > 0.0 { *g } else { 0.0 });
    });
    let (mean, count) = (&statistics.mean, statistics.count.max(1.0));
    // Every row's gradient is already the sum over its cells, so each row counts once.
    let all = (x.len(), 1);
    let products = |g: f32, x: f32, m: f32| [f64::from(g), f64::from(g * (x - m))];
    let [sum, product] = reduce([gradient, x], mean, all, products);
    // dx = scale * (dy - weight * (mean(dy) + (x - mean) * mean(dy * (x - mean)) / variance'))
    let [mut scale, mut constant, mut slope] = [(); 3].map(|()| vec![0.0_f32; channels]);
    for c in 0..channels {
        d_beta[c] += sum[c] as f32;
        let inverse = inverse_deviation(statistics.var[c]);
        let (gain, product) = (f64::from(gamma[c]) * inverse, product[c] * inverse);
        d_gamma[c] += product as f32;
        scale[c] = gain as f32;
        constant[c] = (gain * sum[c] / count) as f32;
        slope[c] = (gain * inverse * product / count) as f32;
    }
    let work = |g: &mut [f32], x: &[f32], weight: f32| {
        for (g, x) in g.chunks_exact_mut(channels).zip(x.chunks_exact(channels)) {
            let terms = scale.iter().zip(&constant).zip(&slope);
            let values = x.iter().zip(mean).zip(terms);
            for (g, ((x, mean), ((scale, constant), slope))) in g.iter_mut().zip(values) {
                // Constant and slope are already scaled.
                *g = scale * *g - weight * (constant + (x - mean) * slope);
            }
        }
    };
    let tail = tail.of(rows);
    let (head, last) = gradient.split_at_mut(x.len() - tail.rows * channels);
    let (x, last_x) = x.split_at(head.len());
    let chunks = head.par_chunks_mut(chunk).zip(x.par_chunks(chunk));
    chunks.for_each(|(g, x)| at_best(|| work(g, x, 1.0)));
    work(last, last_x, tail.multiplicity as f32);
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_geometry::Random;

    /// `of` random values around `mean`.
    fn draw(random: &mut Random, of: usize, mean: f64) -> Vec<f32> {
        (0..of).map(|_| (mean + random.normal()) as f32).collect()
    }

    fn assert_near(a: &[f32], b: &[f32], most: f32) {
        let are_near = a.iter().zip(b).all(|(a, b)| (a - b).abs() < most);
        assert!(a.len() == b.len() && are_near, "{a:?} {b:?}");
    }

    #[test]
    fn the_output_is_the_definition_in_f64() {
        for (rows, channels) in [(0, 4), (1, 16), (2, 3), (5, 48), (257, 31), (9001, 16)] {
            let mut random = Random::new(4, &[rows as u64]);
            // A mean far from zero would show an inaccurate variance.
            let x = draw(&mut random, rows * channels, 20.0);
            let [gamma, beta] = [0, 1].map(|_| draw(&mut random, channels, 0.0));
            let mut y = vec![f32::NAN; x.len()];
            let s = forward(&x, [&gamma, &beta], Tail::default(), &mut y);
            assert_eq!(s.count, rows as f64);
            for c in 0..channels {
                let column = || x.iter().skip(c).step_by(channels).map(|x| f64::from(*x));
                let mean = column().sum::<f64>() / rows.max(1) as f64;
                let var = column().map(|x| (x - mean).powi(2)).sum::<f64>() / rows.max(1) as f64;
                let scale = f64::from(gamma[c]) / (var + f64::from(EPSILON)).sqrt();
                let expected = column().map(|x| scale * (x - mean) + f64::from(beta[c]));
                let expected: Vec<f32> = expected.map(|y| y.max(0.0) as f32).collect();
                let y: Vec<f32> = y.iter().skip(c).step_by(channels).copied().collect();
                assert_near(&y, &expected, 1e-4);
                assert_near(&[s.mean[c], s.var[c]], &[mean as f32, var as f32], 1e-4);
            }
        }
    }
}
