//! Convolution on plain slices: forward (drives the vehicle) and gradients (train).
//!
//! One idea carries every layer of the network: **a map is a list of rows** (one row a cell or a voxel, channels contiguous), and a convolution is a
//! [`Gather`]: for each output row and each tap of the kernel, which input row is read. Dense 3x3, strided, sparse 3-D, 1x1 and transposed 2x2 convolutions
//! differ in their gather alone. A batch is more rows. A cell that is not computed is a row that is not listed. One shape has a way of its own: a 3x3 layer of
//! stride 1 in f32 or i16 takes less than half of the products tile by tile ([`convolve_winograd`]).

mod convolve;
mod element;
mod gather;
mod gradient;
mod simd;
mod weights;
mod winograd;

pub use convolve::{convolve, convolve_at};
pub use element::{Bf16, Element};
pub use gather::{ABSENT, Gather};
pub use gradient::{weight_gradient, weight_gradient_at};
pub use simd::{Level, Tiled, at_best};
pub use weights::Weights;
pub use winograd::{WeightsWinograd, WinogradTiles, convolve_winograd, convolve_winograd_at};

/// What happens to a row after its sum.
#[derive(Clone, Copy, Debug, Default)]
pub struct Epilogue<'a> {
    /// Added to every row; `cout` values.
    pub bias: Option<&'a [f32]>,
    /// max(0, x) after the bias; NaN stays NaN.
    pub relu: bool,
}

impl Epilogue<'_> {
    /// Panics when a bias is not of so many channels.
    fn check(&self, cout: usize) {
        let fits = self.bias.is_none_or(|bias| bias.len() == cout);
        assert!(fits, "a bias for each of {cout} channels");
    }

    /// What no output is below.
    fn floor(&self) -> f32 {
        if self.relu { 0.0 } else { f32::NEG_INFINITY }
    }
}
