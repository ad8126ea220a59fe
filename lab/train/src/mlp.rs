//! Dense layers with ReLU between them, forward and backward: for the OSIS baseline and the cluster scorer.
//!
//! The order of summation is that of the refiner's forward pass, so the bits are the same; the kernels use another order.

use crate::layers::add;
use mluc_geometry::Random;

/// Dense layers on rows.
#[derive(Clone, Debug, PartialEq)]
pub struct Mlp {
    /// Widths, starting with the input's.
    pub widths: Vec<usize>,
    /// Layer by layer: `[in][out]`, then a bias of `[out]`. Further values belong to the owner of the layers.
    pub parameters: Vec<f32>,
}

/// Outputs of the layers in a forward pass, starting with the input.
pub struct Trace(Vec<Vec<f32>>);

impl Trace {
    /// The rows of the last layer.
    pub fn output(&self) -> &[f32] {
        self.0.last().map_or(&[], Vec::as_slice)
    }
}

impl Mlp {
    /// Initial parameters: uniform in +-1/sqrt(fan in).
    pub fn new(widths: &[usize], random: &mut Random) -> Mlp {
        let mut parameters = vec![];
        for pair in widths.windows(2) {
            let bound = 1.0 / (pair[0] as f64).sqrt();
            let count = pair[0] * pair[1] + pair[1];
            parameters.extend((0..count).map(|_| random.uniform(-bound, bound) as f32));
        }
        let widths = widths.to_vec();
        Mlp { widths, parameters }
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

    /// Runs the layers on rows of `widths[0]` values.
    pub fn forward(&self, input: Vec<f32>) -> Trace {
        let rows = input.len() / self.widths[0].max(1);
        let layers = self.layers();
        let mut outputs = vec![input];
        for (number, &(first, cin, cout)) in layers.iter().enumerate() {
            let (weights, rest) = self.parameters[first..].split_at(cin * cout);
            let mut all = vec![0.0f32; rows * cout];
            let inputs = outputs[number].chunks_exact(cin);
            for (x, y) in inputs.zip(all.chunks_exact_mut(cout)) {
                y.copy_from_slice(&rest[..cout]);
                let terms = x.iter().zip(weights.chunks_exact(cout));
                for (x, w) in terms.filter(|(x, _)| **x != 0.0) {
                    y.iter_mut().zip(w).for_each(|(y, w)| *y += x * w);
                }
                if number + 1 < layers.len() {
                    y.iter_mut().for_each(|y| *y = y.max(0.0));
                }
            }
            outputs.push(all);
        }
        Trace(outputs)
    }

    /// The gradient of all parameters from the gradient of the output.
    pub fn backward(&self, Trace(outputs): &Trace, gradient: Vec<f32>) -> Vec<f32> {
        let mut parameters = vec![0.0f32; self.parameters.len()];
        let mut dy = gradient;
        for (number, (first, cin, cout)) in self.layers().into_iter().enumerate().rev() {
            let (weights, bias) = parameters[first..].split_at_mut(cin * cout);
            let plain = &self.parameters[first..first + cin * cout];
            let input = &outputs[number];
            let mut dx = vec![0.0f32; input.len()];
            let rows = input.chunks_exact(cin).zip(dx.chunks_exact_mut(cin));
            for ((x, dx), dy) in rows.zip(dy.chunks_exact(cout)) {
                add(bias, dy);
                for c in 0..cin {
                    let row = c * cout..(c + 1) * cout;
                    if x[c] != 0.0 {
                        weights[row.clone()].iter_mut().zip(dy).for_each(|(w, d)| *w += x[c] * d);
                    }
                    // Where a ReLU is 0 there is no gradient; the gradient of the input itself is not needed.
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
    use crate::testing::assert_gradient;

    #[test]
    fn gradients_are_slopes() {
        let mut random = Random::new(1, &[]);
        let mlp = Mlp::new(&[3, 5, 4, 2], &mut random);
        let input: Vec<f32> = (0..6 * 3).map(|_| random.normal() as f32).collect();
        let loss = |parameters: &[f32]| -> f64 {
            let parameters = parameters.to_vec();
            let widths = mlp.widths.clone();
            let trace = Mlp { widths, parameters }.forward(input.clone());
            let y = trace.output().iter().enumerate();
            y.map(|(i, y)| f64::from(y * y) * (1.0 + i as f64)).sum()
        };
        let trace = mlp.forward(input.clone());
        let y = trace.output().iter().enumerate();
        let d = y.map(|(i, y)| 2.0 * y * (1.0 + i as f32)).collect();
        let gradient = mlp.backward(&trace, d);
        assert_gradient("parameter", &mlp.parameters, &gradient, 2e-2, loss);
    }
}
