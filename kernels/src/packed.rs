//! What the forward convolution asks of packed weights, in any precision.

use crate::{
    Bf16, Element, Weights, WeightsBf16, WeightsInt8,
    simd::{Listed, Simd, convolve_tiles, convolve_tiles_bf16, convolve_tiles_int8},
    weights::{PANEL_MAX, Panel},
};

/// Packed weights.
pub(crate) trait Packed: Sync {
    /// A value of an input row.
    type Input: Sync;
    /// What products are added in.
    type Sum: Copy + Default;

    /// Taps, input channels, output channels.
    fn shape(&self) -> (usize, usize, usize);

    /// Writes what the sums of a row begin with into zeros. `bias`: of the panel's used channels.
    fn begin(&self, bias: Option<&[f32]>, zeros: &mut [Self::Sum]);

    /// `sums[pair.row] += input[pair.input] * weights of the tap`, for each listed pair and each channel of the panel;
    /// `tap` is the first of the listed ones.
    fn tap<S: Simd>(
        &self,
        simd: S,
        input: &[Self::Input],
        panel: Panel,
        tap: usize,
        listed: Listed,
        sums: &mut [Self::Sum],
    );

    /// The sums of a row as its output, not below `floor`. `bias`: as for [`Packed::begin`].
    fn finish<O: Element>(
        &self,
        panel: Panel,
        bias: Option<&[f32]>,
        sums: &[Self::Sum],
        floor: f32,
        output: &mut [O],
    );
}

/// Not below `floor`. Written so that NaN passes.
#[inline(always)]
pub(crate) fn clamp(value: f32, floor: f32) -> f32 {
    if value < floor { floor } else { value }
}

/// Sums in f32 begin with the bias.
#[inline(always)]
fn begin_with_bias(bias: Option<&[f32]>, zeros: &mut [f32]) {
    if let Some(bias) = bias {
        zeros[..bias.len()].copy_from_slice(bias);
    }
}

#[inline(always)]
fn finish_f32<O: Element>(sums: &[f32], floor: f32, output: &mut [O]) {
    let pairs = output.iter_mut().zip(sums);
    pairs.for_each(|(y, &sum)| *y = O::from_f32(clamp(sum, floor)));
}

impl Packed for Weights {
    type Input = f32;
    type Sum = f32;

    fn shape(&self) -> (usize, usize, usize) {
        (self.taps, self.cin, self.cout)
    }

    #[inline(always)]
    fn begin(&self, bias: Option<&[f32]>, zeros: &mut [f32]) {
        begin_with_bias(bias, zeros);
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
        let weights = &self.panel(panel)[tap * size..][..listed.taps() * size];
        convolve_tiles(simd, input, self.cin, listed, weights, panel.width, sums);
    }

    #[inline(always)]
    fn finish<O: Element>(
        &self,
        _: Panel,
        _: Option<&[f32]>,
        sums: &[f32],
        floor: f32,
        output: &mut [O],
    ) {
        finish_f32(sums, floor, output);
    }
}

impl Packed for WeightsBf16 {
    type Input = Bf16;
    type Sum = f32;

    fn shape(&self) -> (usize, usize, usize) {
        (self.taps, self.cin, self.cout)
    }

    #[inline(always)]
    fn begin(&self, bias: Option<&[f32]>, zeros: &mut [f32]) {
        begin_with_bias(bias, zeros);
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
        let weights = &self.panel(panel)[tap * size..][..listed.taps() * size];
        convolve_tiles_bf16(simd, input, self.cin, listed, weights, panel.width, sums);
    }

    #[inline(always)]
    fn finish<O: Element>(
        &self,
        _: Panel,
        _: Option<&[f32]>,
        sums: &[f32],
        floor: f32,
        output: &mut [O],
    ) {
        finish_f32(sums, floor, output);
    }
}

impl Packed for WeightsInt8 {
    type Input = u8;
    type Sum = i32;

    fn shape(&self) -> (usize, usize, usize) {
        (self.taps, self.cin, self.cout)
    }

    #[inline(always)]
    fn begin(&self, _: Option<&[f32]>, _: &mut [i32]) {}

    #[inline(always)]
    fn tap<S: Simd>(
        &self,
        simd: S,
        input: &[u8],
        panel: Panel,
        tap: usize,
        listed: Listed,
        sums: &mut [i32],
    ) {
        let size = self.tap_rows() * panel.width;
        let weights = &self.panel(panel)[tap * size..][..listed.taps() * size];
        convolve_tiles_int8(simd, input, self.cin, listed, weights, panel.width, sums);
    }

    /// Sums are exact; only here is rounded: once the product with the scale, once the sum with the bias.
    #[inline(always)]
    fn finish<O: Element>(
        &self,
        panel: Panel,
        bias: Option<&[f32]>,
        sums: &[i32],
        floor: f32,
        output: &mut [O],
    ) {
        let scale = &self.scale()[panel.first..][..panel.used];
        let bias = bias.unwrap_or(&[0.0; PANEL_MAX][..panel.used]);
        let channels = sums.iter().zip(scale).zip(bias);
        for (y, ((&sum, scale), bias)) in output.iter_mut().zip(channels) {
            *y = O::from_f32(clamp(sum as f32 * scale + bias, floor));
        }
    }
}
