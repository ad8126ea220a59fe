//! The tensors of a network by name.

use crate::error::{ModelError, Result};
use crate::network::{Network, calibrated_layers};
use std::collections::BTreeMap;

/// Tensors with this prefix belong to a baseline of the laboratory that is built on the network; no robot reads them.
pub const BASELINE: &str = "baseline.";
/// The cluster scorer, which a refiner reads if a model has one: dense layers on measurements of a cluster, ReLU between them; the
/// output is the logit that the cluster drives or walks. Layer after layer: `[in][out]`, then a bias of `[out]`.
pub const CLUSTER_SCORER: &str = "clusters.looks";
/// Widths of the cluster scorer's layers, starting with the input.
pub const CLUSTER_SCORER_WIDTHS: [usize; 4] = [14, 32, 16, 1];
/// Number of values of [`CLUSTER_SCORER`].
pub const CLUSTER_SCORER_VALUES: usize = {
    let [a, b, c, d] = CLUSTER_SCORER_WIDTHS;
    (a + 1) * b + (b + 1) * c + (c + 1) * d
};

/// Prefix of the names of layer ranges, which int8 needs: how large the values between the layers get. Optional, all or none: `calibration.LAYER` for
/// the output of each sparse layer and of each layer of both blocks, one value per channel. A byte of 255 stands for that value and 0 for 0 (all of
/// these outputs have passed a ReLU); larger values are clipped. `mluc-lab quantize` writes them.
const CALIBRATION: &str = "calibration.";

/// Name of the tensor of a layer's range.
pub fn calibration_tensor(layer: &str) -> String {
    format!("{CALIBRATION}{layer}")
}

/// Row-major values with their shape.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    /// As documented at [`Network`]'s module: sparse `(out, kz, ky, kx, in)`, dense `(out, in, 3, 3)`, and so on.
    pub shape: Vec<usize>,
    /// Values; their number is the product of the shape.
    pub data: Vec<f32>,
}

/// Weights by name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WeightSet {
    tensors: BTreeMap<String, Tensor>,
}

impl WeightSet {
    /// A set without tensors.
    pub fn new() -> WeightSet {
        WeightSet::default()
    }

    /// Adds or replaces a tensor.
    pub fn insert(&mut self, name: impl Into<String>, shape: Vec<usize>, data: Vec<f32>) {
        self.tensors.insert(name.into(), Tensor { shape, data });
    }

    /// The tensor of this name, if it exists.
    pub fn find(&self, name: &str) -> Option<&Tensor> {
        self.tensors.get(name)
    }

    /// The tensor of this name, to be changed.
    pub fn find_mut(&mut self, name: &str) -> Option<&mut Tensor> {
        self.tensors.get_mut(name)
    }

    /// The values of a tensor that must have `shape`; an error if it is missing or has another shape.
    pub fn get(&self, name: &str, shape: &[usize]) -> Result<&[f32]> {
        let Some(tensor) = self.tensors.get(name) else {
            let cause = format!("of shape {shape:?} is missing");
            return Err(ModelError::tensor(name, cause));
        };
        let mut found = &tensor.shape[..];
        let elements = [tensor.data.len()];
        if found.iter().product::<usize>() != elements[0] {
            found = &elements;
        }
        if found != shape {
            let cause = format!("must have shape {shape:?}, found {found:?}");
            return Err(ModelError::tensor(name, cause));
        }
        Ok(&tensor.data)
    }

    /// All tensors in the order of their names.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Tensor)> {
        self.tensors.iter().map(|(name, tensor)| (name.as_str(), tensor))
    }

    /// Removes a tensor and returns it.
    pub fn remove(&mut self, name: &str) -> Option<Tensor> {
        self.tensors.remove(name)
    }

    /// Whether the set has a calibration; if so, a checked set has all of its tensors.
    pub fn is_calibrated(&self) -> bool {
        self.iter().any(|(name, _)| name.starts_with(CALIBRATION))
    }

    /// The values that a byte of 255 stands for, one per output channel of a layer.
    pub fn range(&self, layer: &str, channels: usize) -> Result<&[f32]> {
        self.get(&calibration_tensor(layer), &[channels])
    }

    /// Adds or replaces the range of a layer.
    pub fn set_range(&mut self, layer: &str, range: Vec<f32>) {
        self.insert(calibration_tensor(layer), vec![range.len()], range);
    }

    /// Removes the calibration, which is invalid after the weights have changed.
    pub fn remove_calibration(&mut self, network: &Network) {
        for (layer, _) in calibrated_layers(network) {
            self.remove(&calibration_tensor(&layer));
        }
    }

    /// Refuses a set with a tensor that is missing, unknown or of another shape, with a value that is not finite, a negative variance, a range that
    /// is not positive, or an incomplete calibration. [`CLUSTER_SCORER`] is optional; tensors of [`BASELINE`] only have to be finite.
    pub fn check(&self, network: &Network) -> Result<()> {
        let mut expected: BTreeMap<_, _> = expected_tensors(network).into_iter().collect();
        if self.find(CLUSTER_SCORER).is_some() {
            expected.insert(CLUSTER_SCORER.into(), vec![CLUSTER_SCORER_VALUES]);
        }
        if self.is_calibrated() {
            let ranges = calibrated_layers(network).into_iter();
            expected.extend(ranges.map(|(layer, cout)| (calibration_tensor(&layer), vec![cout])));
        }
        for (name, shape) in &expected {
            check_values(name, self.get(name, shape)?)?;
        }
        for (name, tensor) in &self.tensors {
            if name.starts_with(BASELINE) {
                check_values(name, &tensor.data)?;
            } else if !expected.contains_key(name) {
                return Err(ModelError::tensor(name, "does not belong to this network"));
            }
        }
        Ok(())
    }
}

fn check_values(name: &str, data: &[f32]) -> Result<()> {
    let (expected, fits): (_, fn(f32) -> bool) = if name.ends_with(".running_var") {
        ("finite and not negative", |value| value >= 0.0)
    } else if name.starts_with(CALIBRATION) {
        ("finite and above 0", |value| value > 0.0)
    } else {
        ("finite", |_| true)
    };
    let is_bad = |value: &f32| !value.is_finite() || !fits(*value);
    let Some(index) = data.iter().position(is_bad) else {
        return Ok(());
    };
    let found = data[index];
    let cause = format!("must be {expected}, found {found} at element {index}");
    Err(ModelError::tensor(name, cause))
}

/// Name and shape of every tensor of a network, in the order of its layers.
pub fn expected_tensors(network: &Network) -> Vec<(String, Vec<usize>)> {
    let mut tensors = vec![];
    let mut normalised = |name: &str, shape: Vec<usize>, channels: usize| {
        tensors.push((format!("{name}.weight"), shape));
        for part in ["weight", "bias", "running_mean", "running_var"] {
            tensors.push((format!("{name}.bn.{part}"), vec![channels]));
        }
    };
    for layer in &network.sparse {
        let [z, y, x] = layer.kernel;
        let shape = vec![layer.cout, z, y, x, layer.cin];
        normalised(&layer.name, shape, layer.cout);
    }
    for layer in network.block1.iter().chain(&network.block2) {
        normalised(&layer.name, vec![layer.cout, layer.cin, 3, 3], layer.cout);
    }
    for layer in [&network.up1, &network.up2] {
        let shape = vec![layer.cin, layer.cout, layer.factor, layer.factor];
        normalised(&layer.name, shape, layer.cout);
    }
    for (name, channels) in network.heads() {
        let shape = vec![channels, network.feature_channels(), 1, 1];
        tensors.push((format!("{name}.weight"), shape));
        tensors.push((format!("{name}.bias"), vec![channels]));
    }
    tensors
}
