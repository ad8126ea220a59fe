//! A few dense layers with ReLU between them, forward and backward, and their Adam: for the point embedding of a baseline.

use super::random::Random;

/// Layers on rows.
#[derive(Clone, Debug, PartialEq)]
pub struct Mlp {
    /// Widths, the input's first.
    pub widths: Vec<usize>,
    /// Layer after layer: `[in][out]`, then a bias of `[out]`.
    pub parameters: Vec<f32>,
}

/// What the layers left: their outputs, the input first.
pub struct Trace {
    rows: usize,
    outputs: Vec<Vec<f32>>,
}

impl Trace {
    /// The last layer's rows.
    pub fn output(&self) -> &[f32] {
        self.outputs.last().map_or(&[], Vec::as_slice)
    }
}

impl Mlp {
    /// Uniform in +-1/sqrt(fan in).
    pub fn new(widths: &[usize], random: &mut Random) -> Mlp {
        let mut parameters = vec![];
        for pair in widths.windows(2) {
            let bound = 1.0 / (pair[0] as f64).sqrt();
            let count = pair[0] * pair[1] + pair[1];
            parameters.extend((0..count).map(|_| random.uniform(-bound, bound) as f32));
        }
        Mlp {
            widths: widths.to_vec(),
            parameters,
        }
    }

    /// First parameter, input and output of each layer.
    fn layers(&self) -> Vec<(usize, usize, usize)> {
        let mut first = 0;
        let layer = |pair: &[usize]| {
            let at = first;
            first += pair[0] * pair[1] + pair[1];
            (at, pair[0], pair[1])
        };
        self.widths.windows(2).map(layer).collect()
    }

    /// Runs rows of `widths[0]` values.
    pub fn forward(&self, input: Vec<f32>) -> Trace {
        let rows = input.len() / self.widths[0].max(1);
        let layers = self.layers();
        let mut outputs = vec![input];
        for (number, &(first, cin, cout)) in layers.iter().enumerate() {
            let weights = &self.parameters[first..first + cin * cout];
            let bias = &self.parameters[first + cin * cout..][..cout];
            let mut y = vec![0.0f32; rows * cout];
            for (x, y) in outputs[number]
                .chunks_exact(cin)
                .zip(y.chunks_exact_mut(cout))
            {
                y.copy_from_slice(bias);
                for (x, w) in x
                    .iter()
                    .zip(weights.chunks_exact(cout))
                    .filter(|(x, _)| **x != 0.0)
                {
                    y.iter_mut().zip(w).for_each(|(y, w)| *y += x * w);
                }
                if number + 1 < layers.len() {
                    y.iter_mut().for_each(|y| *y = y.max(0.0));
                }
            }
            outputs.push(y);
        }
        Trace { rows, outputs }
    }

    /// The gradient of every parameter from that of the output.
    pub fn backward(&self, trace: &Trace, gradient: Vec<f32>) -> Vec<f32> {
        let layers = self.layers();
        let mut parameters = vec![0.0f32; self.parameters.len()];
        let mut dy = gradient;
        for (number, &(first, cin, cout)) in layers.iter().enumerate().rev() {
            let (weights, bias) = parameters[first..].split_at_mut(cin * cout);
            let input = &trace.outputs[number];
            let mut dx = vec![0.0f32; trace.rows * cin];
            let plain = &self.parameters[first..first + cin * cout];
            let rows = input.chunks_exact(cin).zip(dx.chunks_exact_mut(cin));
            for ((x, dx), dy) in rows.zip(dy.chunks_exact(cout)) {
                bias.iter_mut().zip(dy).for_each(|(b, d)| *b += d);
                for c in 0..cin {
                    let row = c * cout..(c + 1) * cout;
                    if x[c] != 0.0 {
                        weights[row.clone()]
                            .iter_mut()
                            .zip(dy)
                            .for_each(|(w, d)| *w += x[c] * d);
                    }
                    // Beyond a ReLU that is shut nothing flows; the input itself wants no gradient.
                    if number > 0 && x[c] > 0.0 {
                        dx[c] = plain[row].iter().zip(dy).map(|(w, d)| w * d).sum();
                    }
                }
            }
            dy = dx;
        }
        parameters
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradients_are_slopes() {
        let mut random = Random::new(1, &[]);
        let mlp = Mlp::new(&[3, 5, 4, 2], &mut random);
        let input: Vec<f32> = (0..6 * 3).map(|_| random.normal() as f32).collect();
        let loss = |mlp: &Mlp| -> f64 {
            let y = mlp.forward(input.clone());
            y.output()
                .iter()
                .enumerate()
                .map(|(i, y)| f64::from(y * y) * (1.0 + i as f64))
                .sum()
        };
        let trace = mlp.forward(input.clone());
        let d = trace
            .output()
            .iter()
            .enumerate()
            .map(|(i, y)| 2.0 * y * (1.0 + i as f32));
        let gradient = mlp.backward(&trace, d.collect());
        for i in 0..mlp.parameters.len() {
            let at = |h: f32| {
                let mut moved = mlp.clone();
                moved.parameters[i] += h;
                loss(&moved)
            };
            // A large step meets ReLU's kinks, a small one rounding: any will do.
            let slopes = [4e-3f32, 1e-3, 2e-4].map(|h| (at(h) - at(-h)) / f64::from(2.0 * h));
            let wanted = f64::from(gradient[i]);
            let agrees = |slope: &f64| (slope - wanted).abs() < 2e-2 * (1.0 + slope.abs());
            assert!(
                slopes.iter().any(agrees),
                "{i}: {slopes:?} against {wanted}"
            );
        }
    }
}
