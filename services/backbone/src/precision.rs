//! The precision in which the layers multiply.

use mluc_kernels::{Bf16, Element, Tiled};
use serde::{Deserialize, Serialize};

/// The number format of rows and weights between the first layer and the feature rows.
///
/// The first sparse layer reads coordinates in m, of which bf16 would keep 8 bits: it is computed in f32. The feature rows are f32 too.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// The fastest on this processor whose cost in accuracy the model file records and [`Precision::COST_MAX`] allows.
    Auto,
    /// 32 bits.
    #[default]
    F32,
    /// 16 bits, 8 of them of the fraction: half the memory, and twice the products per cycle on a processor that has them. Sums are f32.
    Bf16,
    /// 8 bits, with a scale for each channel: a quarter of the memory, and four times the products per cycle
    /// on a processor that has them. Sums are exact. The model needs a calibration.
    Int8,
}

impl Precision {
    /// The precisions in which layers can multiply, the most exact first.
    pub const ALL: [Precision; 3] = [Precision::F32, Precision::Bf16, Precision::Int8];

    /// The name in configurations: `auto`, `f32`, `bf16`, `int8`.
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

/// The rows that a layer by tiles reads and writes.
type TiledRows<'a, I> = (&'a [I], &'a mut [I]);

/// A value of the rows between two layers.
pub(crate) trait Value: Element + std::fmt::Debug + 'static {
    /// The type that layers by tiles multiply; not used if [`Value::tiled`] returns `None`.
    type Tiled: Tiled + std::fmt::Debug;

    /// Whether the conversion of a value or a weight to this type rounds.
    const ROUNDS: bool = true;

    /// The rows to read and the rows to write, if layers by tiles multiply this type.
    fn tiled<'a>(_: &'a [Self], _: &'a mut [Self]) -> Option<TiledRows<'a, Self::Tiled>> {
        None
    }

    /// The same values as f32; converted values are written to `spare`.
    fn as_f32<'a>(values: &'a [Self], spare: &'a mut Vec<f32>) -> &'a [f32] {
        spare.clear();
        spare.extend(values.iter().map(|value| value.to_f32()));
        spare
    }
}

impl Value for f32 {
    type Tiled = f32;
    const ROUNDS: bool = false;

    fn tiled<'a>(input: &'a [f32], output: &'a mut [f32]) -> Option<TiledRows<'a, f32>> {
        Some((input, output))
    }

    fn as_f32<'a>(values: &'a [f32], _: &'a mut Vec<f32>) -> &'a [f32] {
        values
    }
}

impl Value for Bf16 {
    type Tiled = f32;
}

/// Counts with a scale for each channel, see [`crate::quant_scale::QuantScale`].
impl Value for u8 {
    type Tiled = i16;
}

/// The same counts as u8.
impl Value for i16 {
    type Tiled = i16;

    fn tiled<'a>(input: &'a [i16], output: &'a mut [i16]) -> Option<TiledRows<'a, i16>> {
        Some((input, output))
    }
}
