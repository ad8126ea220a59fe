//! Convolution on plain slices: forward (for the vehicle) and gradients (for training).
//!
//! Every layer of the network has the same form: **a map is a list of rows** (one row per cell or voxel, channels contiguous), and a convolution is a
//! [`Gather`]: for each output row and each tap of the kernel, it names the input row to read. Dense 3x3, strided, sparse 3-D, 1x1 and transposed 2x2
//! convolutions differ in their gather alone. A batch has more rows. A cell that is not computed has no row. One shape has its own algorithm: for a
//! 3x3 layer of stride 1 in f32 or i16, [`convolve_winograd`] computes tiles with less than half of the products.

mod convolve;
mod gather;
mod gradient;
mod simd;
mod weights;
mod winograd;

pub use convolve::{convolve, convolve_at};
pub use gather::{ABSENT, Gather};
pub use gradient::{Trainable, weight_gradient};
pub use simd::{Bf16, Element, Level, Tiled, at_best, spin};
pub use weights::Weights;
pub use winograd::{WeightsWinograd, WinogradTiles, convolve_winograd};

/// The operations on a row after its sum.
#[derive(Clone, Copy, Debug, Default)]
pub struct Epilogue<'a> {
    /// Added to every row; `cout` values.
    pub bias: Option<&'a [f32]>,
    /// max(0, x) after the bias; NaN stays NaN.
    pub relu: bool,
}

impl Epilogue<'_> {
    /// Panics when the bias does not have `cout` values.
    fn check(&self, cout: usize) {
        let fits = self.bias.is_none_or(|bias| bias.len() == cout);
        assert!(fits, "a bias for each of {cout} channels");
    }

    /// The lower bound of the output.
    fn floor(&self) -> f32 {
        if self.relu { 0.0 } else { f32::NEG_INFINITY }
    }
}
