//! Weights in the order the kernels read them.

use crate::simd::{Aligned, LINE, Operand};

/// Maximum number of output channels per panel: four AVX-512 registers.
pub(crate) const PANEL_MAX: usize = 64;

/// A run of output channels that one pass of the kernel computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Panel {
    /// First output channel.
    pub(crate) first: usize,
    /// Channels, padding included: 16, 32, 48 or 64.
    pub(crate) width: usize,
    /// Channels without the padding.
    pub(crate) used: usize,
}

/// Cuts `cout` channels into panels of nearly equal width: 96 is 48 + 48 and not 64 + 32.
pub(crate) fn panels(cout: usize) -> impl Iterator<Item = Panel> {
    let lines = cout.div_ceil(LINE);
    let count = (lines * LINE).div_ceil(PANEL_MAX).max(1);
    let (base, wider) = (lines / count, lines % count);
    let mut first = 0;
    (0..count).map(move |panel| {
        let width = (base + usize::from(panel < wider)) * LINE;
        let panel = Panel { first, width, used: width.min(cout - first) };
        first += width;
        panel
    })
}

/// Packed weights of one convolution on rows of `I`: panels of up to 64 output channels, each `[tap][row][width]`, 64-byte aligned, channels padded
/// with zeros to a multiple of 16. A packed row has one input channel in f32 and two in bf16. For input rows of u8 it has four in i8, for i16 two
/// in i16; then each output channel has its own scale, and its largest weight is 127 times the scale.
#[derive(Clone, Debug, PartialEq)]
pub struct Weights<I: Operand = f32> {
    /// Taps of the kernel; equal to the taps of the gather.
    pub taps: usize,
    /// Channels of an input row.
    pub cin: usize,
    /// Channels of an output row.
    pub cout: usize,
    data: Aligned<I::Weight>,
    pub(crate) scale: Vec<f32>,
}

impl<I: Operand> Weights<I> {
    /// Packs `[tap][cin][cout]`, rounded to the packed type. For rows of u8, `plain` maps multiples of the input's unit to multiples
    /// of the output's unit (f32 output: to values).
    ///
    /// # Panics
    /// When `plain` has another length, or sums of u8 could exceed an i32: more than 66,311 inputs per output value (a broken invariant, not data).
    pub fn pack(taps: usize, cin: usize, cout: usize, plain: &[f32]) -> Weights<I> {
        check(plain, [taps, cin, cout]);
        let weight = |[tap, i, o]: [usize; 3]| plain[(tap * cin + i) * cout + o];
        Weights::from_fn([taps, cin, cout], weight)
    }

    /// Packs the transpose of `[tap][cin][cout]`, for the input gradient: rows of `cout` in, rows of `cin` out.
    ///
    /// # Panics
    /// As [`Weights::pack`].
    pub fn pack_transposed(taps: usize, cin: usize, cout: usize, plain: &[f32]) -> Weights<I> {
        check(plain, [taps, cin, cout]);
        let weight = |[tap, i, o]: [usize; 3]| plain[(tap * cin + o) * cout + i];
        Weights::from_fn([taps, cout, cin], weight)
    }

    fn from_fn(shape: [usize; 3], weight: impl Fn([usize; 3]) -> f32) -> Weights<I> {
        let scale = I::scales(shape, &weight);
        Weights::scaled(shape, scale, weight)
    }

    /// `scale`: the value of a packed weight of 1 in each output channel.
    pub(crate) fn scaled(
        [taps, cin, cout]: [usize; 3],
        scale: Vec<f32>,
        weight: impl Fn([usize; 3]) -> f32,
    ) -> Weights<I> {
        let (tap_rows, rows) = (I::tap_rows(cin), taps * I::tap_rows(cin));
        let mut data = Aligned::zeros(rows * cout.next_multiple_of(LINE));
        let values = data.as_mut_slice();
        for panel in panels(cout) {
            for row in 0..rows {
                let (tap, tap_row) = (row / tap_rows, row % tap_rows);
                let to = &mut values[panel.first * rows + row * panel.width..][..panel.used];
                for (o, to) in (panel.first..).zip(to) {
                    *to = I::pack(tap_row, cin, scale[o], |i| weight([tap, i, o]));
                }
            }
        }
        Weights { taps, cin, cout, data, scale }
    }

    /// The value of a packed weight of 1 in each output channel.
    pub fn scale(&self) -> &[f32] {
        &self.scale
    }

    /// `[tap][row][width]` of one panel.
    pub(crate) fn panel(&self, panel: Panel) -> &[I::Weight] {
        let rows = self.taps * I::tap_rows(self.cin);
        &self.data.as_slice()[panel.first * rows..][..panel.width * rows]
    }
}

/// Panics when the weights have another shape.
pub(crate) fn check(plain: &[f32], [taps, cin, cout]: [usize; 3]) {
    let what = format_args!("weights of {taps} x {cin} x {cout}");
    assert_eq!(plain.len(), taps * cin * cout, "{what}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panels_cover_all_channels_once() {
        for cout in 1..=300 {
            let panels: Vec<_> = panels(cout).collect();
            assert_eq!(panels[0].first, 0);
            for two in panels.windows(2) {
                assert_eq!(two[1].first, two[0].first + two[0].width);
            }
            let mut widths = panels.iter().map(|panel| panel.width);
            assert!(widths.all(|width| width % LINE == 0 && (LINE..=PANEL_MAX).contains(&width)));
            assert_eq!(panels.iter().map(|p| p.used).sum::<usize>(), cout);
        }
    }
}
