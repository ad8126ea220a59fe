//! Converts the file's layouts to the kernels' layout, `[tap][cin][cout]`; batch norm is folded in for inference.
//!
//! y = gamma (w * x - mean) / sqrt(var + eps) + beta is again a convolution: with weights w gamma / sqrt(var + eps) and
//! bias beta - mean gamma / sqrt(var + eps).

use crate::network::{DenseLayer, Network, SparseLayer, UpLayer};
use crate::{error::Result, tensors::WeightSet};

/// Added to a variance before the square root (public SECOND configurations).
pub const BATCH_NORM_EPS: f32 = 1e-3;

/// A convolution with its bias, ready to be packed.
#[derive(Clone, Debug, PartialEq)]
pub struct Folded {
    /// Taps of the kernel.
    pub taps: usize,
    /// Input channels.
    pub cin: usize,
    /// Output channels.
    pub cout: usize,
    /// `[tap][cin][cout]`.
    pub weights: Vec<f32>,
    /// `cout` values.
    pub bias: Vec<f32>,
}

impl Folded {
    /// A sparse layer with its batch norm. Taps in (kz, ky, kx) order.
    pub fn sparse(weights: &WeightSet, layer: &SparseLayer) -> Result<Folded> {
        let [z, y, x] = layer.kernel;
        let shape = [layer.cout, z, y, x, layer.cin];
        let (taps, cin) = (layer.taps(), layer.cin);
        let at = |tap: usize, i: usize, o: usize| (o * taps + tap) * cin + i;
        normalised(weights, &layer.name, &shape, [taps, cin, layer.cout], at)
    }

    /// A 3x3 layer with its batch norm. Taps in (ky, kx) order.
    pub fn dense(weights: &WeightSet, layer: &DenseLayer) -> Result<Folded> {
        let (taps, cin) = (9, layer.cin);
        let at = |tap: usize, i: usize, o: usize| (o * cin + i) * taps + tap;
        let shape = [layer.cout, cin, 3, 3];
        normalised(weights, &layer.name, &shape, [taps, cin, layer.cout], at)
    }

    /// A transposed layer with its batch norm: one tap per position (dy, dx) within the output's `factor` x `factor` patch.
    pub fn up(weights: &WeightSet, layer: &UpLayer) -> Result<Folded> {
        let (taps, cout) = (layer.factor * layer.factor, layer.cout);
        let shape = [layer.cin, cout, layer.factor, layer.factor];
        let at = |tap: usize, i: usize, o: usize| (i * cout + o) * taps + tap;
        normalised(weights, &layer.name, &shape, [taps, layer.cin, cout], at)
    }

    /// A head: 1x1 with a bias, no batch norm. `name` and `cout`: an entry of [`Network::heads`].
    pub fn head(weights: &WeightSet, network: &Network, name: &str, cout: usize) -> Result<Folded> {
        let cin = network.feature_channels();
        let source = weights.get(&format!("{name}.weight"), &[cout, cin, 1, 1])?;
        let bias = weights.get(&format!("{name}.bias"), &[cout])?.to_vec();
        let at = |_, i: usize, o: usize| o * cin + i;
        Ok(Folded::arranged(source, bias, [1, cin, cout], at))
    }

    /// `at(tap, cin, cout)`: index of that element in the source.
    fn arranged(
        source: &[f32],
        bias: Vec<f32>,
        [taps, cin, cout]: [usize; 3],
        at: impl Fn(usize, usize, usize) -> usize,
    ) -> Folded {
        let mut weights = Vec::with_capacity(source.len());
        for tap in 0..taps {
            for i in 0..cin {
                weights.extend((0..cout).map(|o| source[at(tap, i, o)]));
            }
        }
        Folded { taps, cin, cout, weights, bias }
    }
}

/// `at(tap, cin, cout)`: index of that element in the file's tensor.
fn normalised(
    weights: &WeightSet,
    name: &str,
    shape: &[usize],
    [taps, cin, cout]: [usize; 3],
    at: impl Fn(usize, usize, usize) -> usize,
) -> Result<Folded> {
    let source = weights.get(&format!("{name}.weight"), shape)?;
    let norm = |part: &str| weights.get(&format!("{name}.bn.{part}"), &[cout]);
    let (gamma, beta) = (norm("weight")?, norm("bias")?);
    let (mean, variance) = (norm("running_mean")?, norm("running_var")?);
    let scale = |o: usize| gamma[o] / (variance[o] + BATCH_NORM_EPS).sqrt();
    let scale: Vec<f32> = (0..cout).map(scale).collect();
    let bias = (0..cout).map(|o| beta[o] - mean[o] * scale[o]).collect();
    let mut folded = Folded::arranged(source, bias, [taps, cin, cout], at);
    for row in folded.weights.chunks_exact_mut(cout) {
        row.iter_mut().zip(&scale).for_each(|(weight, scale)| *weight *= scale);
    }
    Ok(folded)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weights(name: &str, shape: Vec<usize>, cout: usize) -> WeightSet {
        let mut set = WeightSet::new();
        let elements: usize = shape.iter().product();
        let data = (0..elements).map(|i| i as f32).collect();
        set.insert(format!("{name}.weight"), shape, data);
        for (part, value) in
            [("weight", 3.0), ("bias", 0.5), ("running_mean", 2.0), ("running_var", 9.0 - 1e-3)]
        {
            set.insert(format!("{name}.bn.{part}"), vec![cout], vec![value; cout]);
        }
        set
    }

    #[test]
    fn every_layout_arrives_at_tap_cin_cout() -> Result<()> {
        // gamma / sqrt(var + eps) = 1: the values stay, the bias is 0.5 - 2.
        let layer = SparseLayer {
            name: "s".into(),
            submanifold: false,
            floor: false,
            kernel: [3, 1, 1],
            stride: [2, 1, 1],
            padding: [0; 3],
            cin: 2,
            cout: 2,
        };
        let folded = Folded::sparse(&weights("s", vec![2, 3, 1, 1, 2], 2), &layer)?;
        let expected: Vec<f32> = (0..6).flat_map(|i| [i as f32, (i + 6) as f32]).collect();
        assert_eq!(folded.weights, expected);
        assert_eq!(folded.bias, [-1.5, -1.5]);

        let layer = DenseLayer { name: "d".into(), stride: 1, cin: 1, cout: 2 };
        let folded = Folded::dense(&weights("d", vec![2, 1, 3, 3], 2), &layer)?;
        assert_eq!(folded.weights[..4], [0.0, 9.0, 1.0, 10.0]);

        let layer = UpLayer { name: "u".into(), factor: 2, cin: 2, cout: 1 };
        let folded = Folded::up(&weights("u", vec![2, 1, 2, 2], 1), &layer)?;
        assert_eq!(folded.weights, [0.0, 4.0, 1.0, 5.0, 2.0, 6.0, 3.0, 7.0]);
        Ok(())
    }
}
