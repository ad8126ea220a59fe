//! What the forward convolution asks of packed weights, in any precision.

use crate::{
    Bf16, Weights, WeightsBf16,
    simd::{Listed, Simd, convolve_tiles, convolve_tiles_bf16},
    weights::Panel,
};

/// Packed weights.
pub(crate) trait Packed: Sync {
    /// A value of an input row.
    type Input: Sync;

    /// Taps, input channels, output channels.
    fn shape(&self) -> (usize, usize, usize);

    /// `sums[pair.row] += input[pair.input] * weights of the tap`, for each listed pair and each channel of the panel.
    fn tap<S: Simd>(
        &self,
        simd: S,
        input: &[Self::Input],
        panel: Panel,
        tap: usize,
        listed: Listed,
        sums: &mut [f32],
    );
}

impl Packed for Weights {
    type Input = f32;

    fn shape(&self) -> (usize, usize, usize) {
        (self.taps, self.cin, self.cout)
    }

    #[inline(always)]
    fn tap<S: Simd>(
        &self,
        simd: S,
        input: &[f32],
        panel: Panel,
        tap: usize,
        listed: Listed,
        sums: &mut [f32],
    ) {
        let size = self.cin * panel.width;
        let weights = &self.panel(panel)[tap * size..][..size];
        convolve_tiles(simd, input, self.cin, listed, weights, panel.width, sums);
    }
}

impl Packed for WeightsBf16 {
    type Input = Bf16;

    fn shape(&self) -> (usize, usize, usize) {
        (self.taps, self.cin, self.cout)
    }

    #[inline(always)]
    fn tap<S: Simd>(
        &self,
        simd: S,
        input: &[Bf16],
        panel: Panel,
        tap: usize,
        listed: Listed,
        sums: &mut [f32],
    ) {
        let size = self.cin / 2 * panel.width;
        let weights = &self.panel(panel)[tap * size..][..size];
        convolve_tiles_bf16(simd, input, self.cin, listed, weights, panel.width, sums);
    }
}
