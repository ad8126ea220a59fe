//! What int8 needs to know of a model: how large the values between its layers get.
//!
//! Optional tensors of the model file, all or none: `calibration.LAYER` for the output of each sparse layer and of each
//! layer of both blocks, one value a channel. A byte of 255 stands for that value and 0 for 0 (all of these outputs have
//! passed a ReLU); larger values are cut. `mluc-lab quantize` writes them.

use crate::error::Result;
use crate::network::{CALIBRATION, Network, calibrated_layers, calibration_tensor};
use crate::tensors::WeightSet;

impl WeightSet {
    /// Whether there is a calibration: a checked set has all of its tensors then.
    pub fn is_calibrated(&self) -> bool {
        self.iter().any(|(name, _)| name.starts_with(CALIBRATION))
    }

    /// The values that a byte of 255 stands for, one an output channel of a layer.
    pub fn range(&self, layer: &str, channels: usize) -> Result<&[f32]> {
        self.get(&calibration_tensor(layer), &[channels])
    }

    /// Adds or replaces the range of a layer.
    pub fn set_range(&mut self, layer: &str, range: Vec<f32>) {
        self.insert(calibration_tensor(layer), vec![range.len()], range);
    }

    /// Takes the calibration out, after the weights have changed.
    pub fn remove_calibration(&mut self, network: &Network) {
        for (layer, _) in calibrated_layers(network) {
            self.remove(&calibration_tensor(&layer));
        }
    }
}
