//! What a count of 1 is worth in each channel of rows of bytes: a 255th of the channel's range in the calibration.
//!
//! Values are q times the unit. A layer that reads and writes counts has weights w * unit of the input / unit of the
//! output and the bias over the unit of the output; the kernel then rounds the weights of each output channel to 127ths
//! of the largest. So a range for each channel costs nothing at run time.

use mluc_model::{Folded, WeightSet};

use crate::backbone::BackboneError;

/// The units of the channels of rows; none where values stand for themselves.
#[derive(Clone, Debug, Default)]
pub(crate) struct Units(Option<Vec<f32>>);

impl Units {
    /// Values that stand for themselves.
    pub(crate) fn none() -> Units {
        Units(None)
    }

    /// Of a layer's output, by the calibration of a checked model that has one.
    pub(crate) fn of_layer(
        weights: &WeightSet,
        layer: &str,
        channels: usize,
    ) -> Result<Units, BackboneError> {
        let range = weights.range(layer, channels)?;
        Ok(Units(Some(
            range.iter().map(|range| range / 255.0).collect(),
        )))
    }

    /// Each unit so many times in a row: of channels that are the same ones at several heights.
    pub(crate) fn repeated(&self, times: usize) -> Units {
        let repeat = |units: &Vec<f32>| {
            let each = units
                .iter()
                .flat_map(|unit| std::iter::repeat_n(*unit, times));
            each.collect()
        };
        Units(self.0.as_ref().map(repeat))
    }

    /// The layer from counts of `input` to counts of `output`.
    pub(crate) fn between(input: &Units, output: &Units, mut layer: Folded) -> Folded {
        if let Some(units) = &input.0 {
            let rows = layer.weights.chunks_exact_mut(layer.cout);
            for (row, unit) in rows.zip(units.iter().cycle()) {
                row.iter_mut().for_each(|weight| *weight *= unit);
            }
        }
        if let Some(units) = &output.0 {
            let rows = layer.weights.chunks_exact_mut(layer.cout);
            for row in rows.chain([&mut layer.bias[..]]) {
                row.iter_mut()
                    .zip(units)
                    .for_each(|(value, unit)| *value /= unit);
            }
        }
        layer
    }

    /// Turns counts into values; `rows`: of the channels.
    pub(crate) fn apply(&self, rows: &mut [f32]) {
        if let Some(units) = &self.0 {
            for row in rows.chunks_exact_mut(units.len()) {
                row.iter_mut()
                    .zip(units)
                    .for_each(|(value, unit)| *value *= unit);
            }
        }
    }

    /// Values as counts, not rounded.
    pub(crate) fn counts(&self, row: &[f32]) -> Vec<f32> {
        match &self.0 {
            Some(units) => row
                .iter()
                .zip(units)
                .map(|(value, unit)| value / unit)
                .collect(),
            None => row.to_vec(),
        }
    }

    /// Whether values stand for themselves.
    pub(crate) fn is_none(&self) -> bool {
        self.0.is_none()
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
        let input = Units(Some(vec![0.5, 2.0]));
        let output = Units(Some(vec![4.0, 1.0, 0.25]));
        let turned = Units::between(&input, &output, layer.clone());
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
        assert_eq!(
            Units::between(&Units::none(), &Units::none(), layer.clone()),
            layer
        );
    }
}
