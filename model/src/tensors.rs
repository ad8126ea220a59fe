//! The tensors of a network by name.

use std::collections::BTreeMap;

use crate::error::ModelError;
use crate::network::{Network, calibrated_layers, calibration_tensor};

/// Tensors of this prefix belong to a baseline of the laboratory, which stands on the network: no robot reads them.
pub const BASELINE: &str = "baseline.";

/// The judge of clusters, which a refiner reads where a model has one: dense layers on measurements of a cluster, ReLU between
/// them, a logit of being something that drives or walks at the end. Layer after layer: `[in][out]`, then a bias of `[out]`.
pub const LOOKS: &str = "clusters.looks";
/// Widths of its layers, the input's first.
pub const LOOKS_WIDTHS: [usize; 4] = [14, 32, 16, 1];
/// Values of [`LOOKS`].
pub const LOOKS_VALUES: usize = {
    let [a, b, c, d] = LOOKS_WIDTHS;
    (a + 1) * b + (b + 1) * c + (c + 1) * d
};

/// Row-major values with their shape.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    /// As documented at [`Network`]'s module: sparse `(out, kz, ky, kx, in)`, dense `(out, in, 3, 3)`, and so on.
    pub shape: Vec<usize>,
    /// As many as the shape's product.
    pub data: Vec<f32>,
}

/// Weights by name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WeightSet {
    tensors: BTreeMap<String, Tensor>,
}

impl WeightSet {
    /// None yet.
    pub fn new() -> WeightSet {
        WeightSet::default()
    }

    /// Adds or replaces a tensor.
    pub fn insert(&mut self, name: impl Into<String>, shape: Vec<usize>, data: Vec<f32>) {
        self.tensors.insert(name.into(), Tensor { shape, data });
    }

    /// By name, where it is there.
    pub fn find(&self, name: &str) -> Option<&Tensor> {
        self.tensors.get(name)
    }

    /// By name in order to be changed.
    pub fn find_mut(&mut self, name: &str) -> Option<&mut Tensor> {
        self.tensors.get_mut(name)
    }

    /// The values of a tensor that must have `shape`.
    pub fn get(&self, name: &str, shape: &[usize]) -> Result<&[f32], ModelError> {
        let missing = || ModelError::TensorMissing {
            tensor: name.into(),
            expected: shape.to_vec(),
        };
        let tensor = self.tensors.get(name).ok_or_else(missing)?;
        let whole = tensor.data.len() == shape.iter().product::<usize>();
        if tensor.shape != shape || !whole {
            return Err(ModelError::TensorShape {
                tensor: name.into(),
                expected: shape.to_vec(),
                found: if whole {
                    tensor.shape.clone()
                } else {
                    vec![tensor.data.len()]
                },
            });
        }
        Ok(&tensor.data)
    }

    /// In the order of their names.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Tensor)> {
        self.tensors
            .iter()
            .map(|(name, tensor)| (name.as_str(), tensor))
    }

    /// Takes a tensor out.
    pub fn remove(&mut self, name: &str) -> Option<Tensor> {
        self.tensors.remove(name)
    }

    /// Refuses a set with a tensor missing, extra, of another shape, or with a value that is no number (a variance:
    /// or below 0), and a calibration that is not whole. [`LOOKS`] may be there or not; tensors of [`BASELINE`] are kept as
    /// they are if they are numbers.
    pub fn check(&self, network: &Network) -> Result<(), ModelError> {
        let mut expected: BTreeMap<_, _> = expected_tensors(network).into_iter().collect();
        if self.find(LOOKS).is_some() {
            expected.insert(LOOKS.into(), vec![LOOKS_VALUES]);
        }
        for (name, shape) in &expected {
            check_values(name, self.get(name, shape)?)?;
        }
        let ranges = calibrated_layers(network).into_iter();
        let ranges: Vec<_> = ranges
            .map(|(layer, channels)| (calibration_tensor(&layer), vec![channels]))
            .collect();
        if self.is_calibrated() {
            self.check_calibration(network)?;
            expected.extend(ranges);
        }
        let baseline = |name: &String| name.starts_with(BASELINE);
        for (name, tensor) in self.tensors.iter().filter(|(name, _)| baseline(name)) {
            check_values(name, &tensor.data)?;
        }
        match self
            .tensors
            .keys()
            .find(|name| !expected.contains_key(*name) && !baseline(name))
        {
            Some(name) => Err(ModelError::TensorUnknown {
                tensor: name.clone(),
            }),
            None => Ok(()),
        }
    }
}

fn check_values(name: &str, data: &[f32]) -> Result<(), ModelError> {
    let is_variance = name.ends_with(".running_var");
    let bad = |value: &f32| !value.is_finite() || (is_variance && *value < 0.0);
    match data.iter().position(bad) {
        None => Ok(()),
        Some(index) => Err(ModelError::TensorValue {
            tensor: name.into(),
            index,
            expected: if is_variance {
                "finite and not negative"
            } else {
                "finite"
            },
            found: data[index],
        }),
    }
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
        normalised(
            &layer.name,
            vec![layer.cout, z, y, x, layer.cin],
            layer.cout,
        );
    }
    for layer in network.block1.iter().chain(&network.block2) {
        normalised(&layer.name, vec![layer.cout, layer.cin, 3, 3], layer.cout);
    }
    for layer in [&network.up1, &network.up2] {
        normalised(
            &layer.name,
            vec![layer.cin, layer.cout, layer.factor, layer.factor],
            layer.cout,
        );
    }
    for (name, channels) in network.heads() {
        tensors.push((
            format!("{name}.weight"),
            vec![channels, network.feature_channels(), 1, 1],
        ));
        tensors.push((format!("{name}.bias"), vec![channels]));
    }
    tensors
}
