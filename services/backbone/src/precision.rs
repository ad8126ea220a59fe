//! In what precision the layers multiply.

use mluc_kernels::{Bf16, Element, Tiled};
use serde::{Deserialize, Serialize};

/// What rows and weights hold between the first layer and the feature rows.
///
/// The first sparse layer reads coordinates in m, of which bf16 would keep 8 bits: it is computed in f32, and the feature rows leave as f32.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// The fastest on this processor whose cost in accuracy the model file records and [`Precision::COST_MAX`] allows.
    Auto,
    /// 32 bits.
    #[default]
    F32,
    /// 16 bits, 8 of them of the fraction: half the memory, and twice the products a cycle where the processor has them. Sums are f32.
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

/// What a layer by tiles reads and writes.
type TiledRows<'a, I> = (&'a [I], &'a mut [I]);

/// What the rows between two layers hold.
pub(crate) trait Value: Element + std::fmt::Debug + 'static {
    /// What layers by tiles multiply: itself, or it has none.
    type Tiled: Tiled + std::fmt::Debug;

    /// Whether a value or a weight is rounded when it becomes one of these.
    const ROUNDS: bool = true;

    /// Rows to be read and rows to be written, where layers by tiles multiply them.
    fn tiled<'a>(_: &'a [Self], _: &'a mut [Self]) -> Option<TiledRows<'a, Self::Tiled>> {
        None
    }

    /// The same values as f32; `spare` is used where they have to be written out.
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

/// Counts whose scale differs from channel to channel, see [`crate::quant_scale::QuantScale`].
impl Value for u8 {
    type Tiled = i16;
}

/// Counts as those of u8.
impl Value for i16 {
    type Tiled = i16;

    fn tiled<'a>(input: &'a [i16], output: &'a mut [i16]) -> Option<TiledRows<'a, i16>> {
        Some((input, output))
    }
}
