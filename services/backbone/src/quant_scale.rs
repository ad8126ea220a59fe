//! The scale of int8 rows: the value of a count of 1 in each channel, which is 1/255 of the channel's range in the calibration.
//!
//! A value is its count times the scale. A layer that reads and writes counts has the weights w * input scale / output scale,
//! and its bias is divided by the output scale; the kernel then rounds the weights of each output channel to multiples of 1/127
//! of the largest. So a range for each channel costs nothing at run time.

use crate::error::Result;
use mluc_model::{Folded, WeightSet};

/// The scale of each channel of a row; `None`: values are plain numbers.
#[derive(Clone, Debug, Default)]
pub(crate) struct QuantScale(pub(crate) Option<Vec<f32>>);

impl QuantScale {
    /// The scale of rows of plain numbers.
    pub(crate) fn identity() -> QuantScale {
        QuantScale(None)
    }

    /// The scale of a layer's output, from the calibration of a checked model that has one.
    pub(crate) fn of_layer(weights: &WeightSet, layer: &str, count: usize) -> Result<QuantScale> {
        let range = weights.range(layer, count)?;
        let scale = range.iter().map(|range| range / 255.0);
        Ok(QuantScale(Some(scale.collect())))
    }

    /// Each scale repeated `times` times in succession, for channels that stand for the same channel at several heights.
    pub(crate) fn repeated(&self, times: usize) -> QuantScale {
        let repeat = |scale: &Vec<f32>| scale.iter().flat_map(|one| [*one].repeat(times)).collect();
        QuantScale(self.0.as_ref().map(repeat))
    }

    /// The layer converted to read counts of `input` and to write counts of `output`.
    pub(crate) fn between(input: &QuantScale, output: &QuantScale, mut layer: Folded) -> Folded {
        if let Some(scale) = &input.0 {
            let rows = layer.weights.chunks_exact_mut(layer.cout);
            for (row, one) in rows.zip(scale.iter().cycle()) {
                row.iter_mut().for_each(|weight| *weight *= one);
            }
        }
        if let Some(scale) = &output.0 {
            let rows = layer.weights.chunks_exact_mut(layer.cout);
            for row in rows.chain([&mut layer.bias[..]]) {
                row.iter_mut().zip(scale).for_each(|(value, one)| *value /= one);
            }
        }
        layer
    }

    /// Converts counts to values in place; `rows`: whole rows.
    pub(crate) fn apply(&self, rows: &mut [f32]) {
        if let Some(scale) = &self.0 {
            for row in rows.chunks_exact_mut(scale.len()) {
                row.iter_mut().zip(scale).for_each(|(value, one)| *value *= one);
            }
        }
    }

    /// Converts values to counts, without rounding.
    pub(crate) fn counts(&self, row: &[f32]) -> Vec<f32> {
        let Some(scale) = &self.0 else {
            return row.to_vec();
        };
        row.iter().zip(scale).map(|(value, one)| value / one).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_layer_between_units_gives_the_same_values() {
        let layer = Folded {
            taps: 2,
            cin: 2,
            cout: 3,
            weights: (0..12).map(|i| i as f32).collect(),
            bias: vec![1.0, 2.0, 3.0],
        };
        let input = QuantScale(Some(vec![0.5, 2.0]));
        let output = QuantScale(Some(vec![4.0, 1.0, 0.25]));
        let turned = QuantScale::between(&input, &output, layer.clone());
        for tap in 0..2 {
            for o in 0..3 {
                // Counts of 6 and 1 stand for 3 and 2.
                let at = |layer: &Folded, i: usize| layer.weights[(tap * 2 + i) * 3 + o];
                let counts = 6.0 * at(&turned, 0) + at(&turned, 1) + turned.bias[o];
                let value = 3.0 * at(&layer, 0) + 2.0 * at(&layer, 1) + layer.bias[o];
                assert!((counts * [4.0, 1.0, 0.25][o] - value).abs() < 1e-4);
            }
        }
        let mut row = [3.0, 3.0, 4.0, 4.0];
        input.apply(&mut row);
        assert_eq!(row, [1.5, 6.0, 2.0, 8.0]);
        assert_eq!(input.repeated(2).0, Some(vec![0.5, 0.5, 2.0, 2.0]));
        let identity = QuantScale::identity();
        let same = QuantScale::between(&identity, &identity, layer.clone());
        assert_eq!(same, layer);
    }
}
