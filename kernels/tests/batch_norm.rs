//! Batch normalisation against a plain one in f64, finite differences, and itself with the last row written out.

mod common;

use common::{Random, assert_near, with_threads};
use mluc_kernels::{BatchNorm, Statistics};

const EPS: f32 = 1e-3;

struct Case {
    channels: usize,
    multiplicity: f32,
    relu: bool,
    x: Vec<f32>,
    gamma: Vec<f32>,
    beta: Vec<f32>,
    dy: Vec<f32>,
}

#[derive(PartialEq)]
struct Found {
    statistics: Statistics,
    y: Vec<f32>,
    dx: Vec<f32>,
    dgamma: Vec<f32>,
    dbeta: Vec<f32>,
}

impl Case {
    fn random(rows: usize, channels: usize, multiplicity: f32, relu: bool) -> Case {
        let mut random = Random((rows * channels) as u64);
        // A mean far from zero is where a careless variance would show.
        let x = random.values(rows * channels).into_iter();
        let x = x.map(|x| 3.0 * x + 20.0).collect();
        let (gamma, beta) = (random.values(channels), random.values(channels));
        Case {
            channels,
            multiplicity,
            relu,
            x,
            gamma,
            beta,
            dy: random.values(rows * channels),
        }
    }

    fn run(&self) -> Found {
        let norm = BatchNorm {
            gamma: &self.gamma,
            beta: &self.beta,
            eps: EPS,
            relu: self.relu,
            last_multiplicity: self.multiplicity,
        };
        let (mut y, mut dx) = (vec![f32::NAN; self.x.len()], self.dy.clone());
        let statistics = norm.forward(&self.x, &mut y);
        let (mut dgamma, mut dbeta) = (vec![0.5; self.channels], vec![0.5; self.channels]);
        norm.backward(&self.x, &y, &mut dx, &statistics, &mut dgamma, &mut dbeta);
        Found {
            statistics,
            y,
            dx,
            dgamma,
            dbeta,
        }
    }

    /// Outputs in f64, for a batch without multiplicity.
    fn plain(&self) -> Vec<f64> {
        let [x, gamma, beta] = [&self.x, &self.gamma, &self.beta].map(|values| wide(values));
        plain(&x, self.channels, &gamma, &beta, self.relu)
    }

    /// The same batch with the last row repeated, an equal share of its gradient in each copy.
    fn written_out(&self) -> Case {
        let copies = self.multiplicity as usize;
        let last = self.x.len() - self.channels;
        let (mut x, mut dy) = (self.x[..last].to_vec(), self.dy[..last].to_vec());
        for _ in 0..copies {
            x.extend(&self.x[last..]);
            dy.extend(self.dy[last..].iter().map(|dy| dy / self.multiplicity));
        }
        Case {
            multiplicity: 1.0,
            x,
            dy,
            gamma: self.gamma.clone(),
            beta: self.beta.clone(),
            ..*self
        }
    }
}

/// Outputs in f64, for a batch without multiplicity.
fn plain(x: &[f64], channels: usize, gamma: &[f64], beta: &[f64], relu: bool) -> Vec<f64> {
    let rows = x.len() / channels;
    let mut y = vec![0.0; x.len()];
    for c in 0..channels {
        let column = || x[c..].iter().step_by(channels);
        let mean = column().sum::<f64>() / rows as f64;
        let var = column().map(|x| (x - mean) * (x - mean)).sum::<f64>() / rows as f64;
        for (row, x) in column().enumerate() {
            let value = gamma[c] * (x - mean) / (var + f64::from(EPS)).sqrt() + beta[c];
            y[row * channels + c] = if relu { value.max(0.0) } else { value };
        }
    }
    y
}

fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&x| f64::from(x)).collect()
}

#[test]
fn forward_equals_plain() {
    for (rows, channels) in [(1, 16), (2, 3), (5, 48), (257, 31), (1500, 96), (9001, 16)] {
        for relu in [false, true] {
            let case = Case::random(rows, channels, 1.0, relu);
            let what = format!("{rows} x {channels}");
            assert_near(&case.run().y, &case.plain(), 1e-5, &what);
        }
    }
}

#[test]
fn multiplicity_equals_the_row_written_out() {
    for (rows, channels, multiplicity) in [(1, 16, 5.0), (40, 48, 60.0), (700, 20, 3000.0)] {
        for relu in [false, true] {
            let case = Case::random(rows, channels, multiplicity, relu);
            let (found, full) = (case.run(), case.written_out().run());
            let what = format!("{rows} x {channels}, {multiplicity} times");
            let near =
                |found: &[f32], expected: &[f32]| assert_near(found, &wide(expected), 1e-5, &what);
            assert_eq!(found.statistics.count, full.statistics.count);
            near(&found.statistics.mean, &full.statistics.mean);
            near(&found.statistics.var, &full.statistics.var);
            near(&found.y, &full.y[..rows * channels]);
            near(&found.dgamma, &full.dgamma);
            near(&found.dbeta, &full.dbeta);
            let last = (rows - 1) * channels;
            near(&found.dx[..last], &full.dx[..last]);
            let mut sum = vec![0.0; channels];
            for row in full.dx[last..].chunks_exact(channels) {
                let pairs = sum.iter_mut().zip(row);
                pairs.for_each(|(sum, dx)| *sum += f64::from(*dx));
            }
            assert_near(&found.dx[last..], &sum, 1e-5, &what);
        }
    }
}

#[test]
fn gradients_equal_finite_differences() {
    let channels = 7;
    let case = Case::random(23, channels, 1.0, true);
    let [x, gamma, beta, dy] = [&case.x, &case.gamma, &case.beta, &case.dy].map(|v| wide(v));
    let loss = |x: &[f64], gamma: &[f64], beta: &[f64]| -> f64 {
        let y = plain(x, channels, gamma, beta, true);
        y.iter().zip(&dy).map(|(y, dy)| y * dy).sum()
    };
    let slope = |of: &[f64], loss: &dyn Fn(&[f64]) -> f64| -> Vec<f64> {
        let step = 1e-5;
        let nudged = |at: usize, by: f64| {
            let mut values = of.to_vec();
            values[at] += by;
            loss(&values)
        };
        let slope = |at| (nudged(at, step) - nudged(at, -step)) / (2.0 * step);
        (0..of.len()).map(slope).collect()
    };
    let found = case.run();
    let half = |values: Vec<f64>| values.iter().map(|v| v + 0.5).collect::<Vec<_>>();
    let expected = slope(&x, &|x| loss(x, &gamma, &beta));
    assert_near(&found.dx, &expected, 1e-5, "x");
    let expected = half(slope(&gamma, &|gamma| loss(&x, gamma, &beta)));
    assert_near(&found.dgamma, &expected, 1e-5, "gamma");
    let expected = half(slope(&beta, &|beta| loss(&x, &gamma, beta)));
    assert_near(&found.dbeta, &expected, 1e-5, "beta");
}

#[test]
fn same_bits_with_any_number_of_threads() {
    let case = Case::random(20_001, 48, 15_000.0, true);
    let one = with_threads(1, || case.run());
    assert!(one == with_threads(2, || case.run()), "1 and 2 threads");
    assert!(one == with_threads(3, || case.run()), "1 and 3 threads");
}

#[test]
fn no_rows_give_no_statistics() {
    let case = Case::random(0, 4, 1.0, true);
    let found = case.run();
    let Statistics { mean, var, count } = found.statistics;
    assert_eq!((mean, var, count), (vec![0.0; 4], vec![0.0; 4], 0.0));
    assert_eq!((found.dgamma, found.dbeta), (vec![0.5; 4], vec![0.5; 4]));
}
