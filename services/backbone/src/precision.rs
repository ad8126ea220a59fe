//! In what precision the layers multiply.

use mluc_kernels::{Bf16, Element};
use serde::{Deserialize, Serialize};

use crate::error::BackboneError;

/// What rows and weights hold between the first layer and the feature rows.
///
/// The first sparse layer reads coordinates in m, of which bf16 would keep 8 bits: it is computed in f32, and the feature
/// rows leave as f32.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// The fastest on this processor whose cost in accuracy the model file records and [`Precision::COST_MAX`] allows.
    Auto,
    /// 32 bits.
    #[default]
    F32,
    /// 16 bits, 8 of them of the fraction: half the memory, and twice the products a cycle where the processor has them.
    /// Sums are f32.
    Bf16,
    /// 8 bits, with a scale for each channel: a quarter of the memory, and four times the products a cycle
    /// where the processor has them. Sums are exact. The model needs a calibration.
    Int8,
}

impl Precision {
    /// What layers can multiply in, the most exact first.
    pub const ALL: [Precision; 3] = [Precision::F32, Precision::Bf16, Precision::Int8];

    /// As configurations write it: `auto`, `f32`, `bf16`, `int8`.
    pub fn name(self) -> &'static str {
        match self {
            Precision::Auto => "auto",
            Precision::F32 => "f32",
            Precision::Bf16 => "bf16",
            Precision::Int8 => "int8",
        }
    }
}

impl std::fmt::Display for Precision {
    fn fmt(&self, to: &mut std::fmt::Formatter) -> std::fmt::Result {
        to.write_str(self.name())
    }
}

impl std::str::FromStr for Precision {
    type Err = BackboneError;

    fn from_str(name: &str) -> Result<Precision, BackboneError> {
        let mut all = Precision::ALL.into_iter().chain([Precision::Auto]);
        all.find(|precision| precision.name() == name)
            .ok_or_else(|| BackboneError::Precision { found: name.into() })
    }
}

/// What the rows between two layers hold.
pub(crate) trait Value: Element + std::fmt::Debug + 'static {
    /// Whether a value or a weight is rounded when it becomes one of these.
    const ROUNDS: bool = true;

    /// Input channels that weights are packed by: a layer's must be a multiple.
    const CHANNELS: usize = 1;

    /// These rows, where they hold f32.
    fn f32_rows(_: &[Self]) -> Option<&[f32]> {
        None
    }

    /// [`Value::f32_rows`], to be written.
    fn f32_rows_mut(_: &mut [Self]) -> Option<&mut [f32]> {
        None
    }

    /// The same values as f32; `spare` is used where they have to be written out.
    fn as_f32<'a>(values: &'a [Self], spare: &'a mut Vec<f32>) -> &'a [f32];
}

impl Value for f32 {
    const ROUNDS: bool = false;

    fn f32_rows(rows: &[f32]) -> Option<&[f32]> {
        Some(rows)
    }

    fn f32_rows_mut(rows: &mut [f32]) -> Option<&mut [f32]> {
        Some(rows)
    }

    fn as_f32<'a>(values: &'a [f32], _: &'a mut Vec<f32>) -> &'a [f32] {
        values
    }
}

impl Value for Bf16 {
    const CHANNELS: usize = 2;

    fn as_f32<'a>(values: &'a [Bf16], spare: &'a mut Vec<f32>) -> &'a [f32] {
        written_out(values, spare)
    }
}

/// Counts whose scale differs from channel to channel, see [`crate::quant_scale::QuantScale`].
impl Value for u8 {
    fn as_f32<'a>(values: &'a [u8], spare: &'a mut Vec<f32>) -> &'a [f32] {
        written_out(values, spare)
    }
}

fn written_out<'a, V: Element>(values: &[V], spare: &'a mut Vec<f32>) -> &'a [f32] {
    spare.clear();
    spare.extend(values.iter().map(|value| value.to_f32()));
    spare
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_come_back_and_others_are_refused() {
        for precision in Precision::ALL.into_iter().chain([Precision::Auto]) {
            assert_eq!(precision.name().parse::<Precision>().ok(), Some(precision));
        }
        let error = "fp16".parse::<Precision>().expect_err("no such precision");
        let expected = "precision: auto, f32, bf16 or int8 expected, found `fp16`";
        assert_eq!(error.to_string(), expected);
    }
}
