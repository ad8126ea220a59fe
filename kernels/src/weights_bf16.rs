//! Weights in bf16, two input channels side by side as the processor multiplies them.

use crate::{
    Bf16,
    simd::{Aligned, LINE},
    weights::{Panel, panels},
};

/// Weights of one convolution in bf16: panels of up to 64 output channels, each `[tap][cin / 2][width][2]`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WeightsBf16 {
    /// Taps of the kernel; equal to those of the gather.
    pub taps: usize,
    /// Channels of an input row; even.
    pub cin: usize,
    /// Channels of an output row.
    pub cout: usize,
    data: Aligned<u32>,
}

impl WeightsBf16 {
    /// Rounds `[tap][cin][cout]` and packs it.
    ///
    /// # Panics
    /// When `plain` has another length, or `cin` is odd (a broken invariant, not data).
    pub fn pack(taps: usize, cin: usize, cout: usize, plain: &[f32]) -> WeightsBf16 {
        assert_eq!(
            plain.len(),
            taps * cin * cout,
            "weights of {taps} x {cin} x {cout}"
        );
        assert!(
            cin.is_multiple_of(2),
            "bf16 needs an even number of input channels, not {cin}"
        );
        let rows = taps * cin / 2;
        let mut data = Aligned::zeros(rows * cout.next_multiple_of(LINE));
        let values = data.as_mut_slice();
        let bits = |row: usize, o: usize| u32::from(Bf16::from_f32(plain[row * cout + o]).0);
        for panel in panels(cout) {
            for row in 0..rows {
                let to = &mut values[panel.first * rows + row * panel.width..][..panel.used];
                for (o, to) in (panel.first..).zip(to) {
                    *to = bits(2 * row, o) | bits(2 * row + 1, o) << 16;
                }
            }
        }
        WeightsBf16 {
            taps,
            cin,
            cout,
            data,
        }
    }

    /// `[tap][cin / 2][width]` of one panel, the even channel in the lower half.
    pub(crate) fn panel(&self, panel: Panel) -> &[u32] {
        let rows = self.taps * self.cin / 2;
        &self.data.as_slice()[panel.first * rows..][..panel.width * rows]
    }
}
