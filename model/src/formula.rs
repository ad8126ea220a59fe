//! Weights from a formula: the same on every machine, without a file. For tests and for timing a network before it is trained.

use crate::{network::Network, tensors::WeightSet, tensors::expected_tensors};
use mluc_geometry::{FNV_OFFSET, Random, fnv1a};

/// A number in [0, 1) for element `index` of the tensor `name`: the first output of SplitMix64 from the state FNV-1a of the name + `index`.
pub fn formula_uniform(name: &str, index: usize) -> f64 {
    let state = fnv1a(FNV_OFFSET, name.as_bytes()).wrapping_add(index as u64);
    (Random::from_state(state).bits() >> 40) as f64 / (1u64 << 24) as f64
}

/// Every tensor of `network`: weights uniform within +-sqrt(6 / fan-in), batch norms near 1, biases near 0.
pub fn formula_weights(network: &Network) -> WeightSet {
    let mut weights = WeightSet::new();
    for (name, shape) in expected_tensors(network) {
        let elements = shape.iter().product();
        let element = |i| value(&name, &shape, formula_uniform(&name, i)) as f32;
        let data = (0..elements).map(element).collect();
        weights.insert(name, shape, data);
    }
    weights
}

fn value(name: &str, shape: &[usize], u: f64) -> f64 {
    let signed = |fan_in: usize| (2.0 * u - 1.0) * (6.0 / fan_in as f64).sqrt();
    match (name.rsplit('.').next(), shape) {
        (Some("running_var"), _) => 0.5 + u,
        (Some("weight"), [_]) => 0.8 + 0.4 * u,
        (_, [_]) => 0.2 * u - 0.1,
        (_, [_, kz, ky, kx, cin]) => signed(kz * ky * kx * cin),
        (_, [cin, ..]) if name.starts_with("backbone2d.up") => signed(*cin),
        (_, rest) => signed(rest.iter().skip(1).product()),
    }
}
