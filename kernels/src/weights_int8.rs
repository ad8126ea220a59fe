//! Weights in i8, four input channels side by side as the processor multiplies them.

use crate::{
    simd::{Aligned, LINE},
    weights::{Panel, panels},
};

/// The largest weight; -128 is left out, so that the range is symmetric.
const LARGEST: f32 = 127.0;
/// Products of so many inputs (255 at most) and weights fit an i32.
const INPUTS_MAX: usize = i32::MAX as usize / (255 * 127);

/// Weights of one convolution in i8: panels of up to 64 output channels, each `[tap][cin / 4, rounded up, + 1][width][4]`.
///
/// Each output channel has its own scale: its largest weight is 127 of it. The last row of a tap is 128 times the sum of
/// each column as i32, for processors that multiply signed bytes alone.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WeightsInt8 {
    /// Taps of the kernel; equal to those of the gather.
    pub taps: usize,
    /// Channels of an input row.
    pub cin: usize,
    /// Channels of an output row.
    pub cout: usize,
    data: Aligned<u32>,
    /// What a sum of 1 is worth in each output channel.
    scale: Vec<f32>,
}

impl WeightsInt8 {
    /// Rounds `[tap][cin][cout]` and packs it. `plain` turns counts of the input's units into counts of the output's
    /// (f32 output: into values).
    ///
    /// # Panics
    /// When `plain` has another length, or its sums could exceed an i32: more than 66,311 inputs of a value (a broken
    /// invariant, not data).
    pub fn pack(taps: usize, cin: usize, cout: usize, plain: &[f32]) -> WeightsInt8 {
        assert_eq!(
            plain.len(),
            taps * cin * cout,
            "weights of {taps} x {cin} x {cout}"
        );
        assert!(taps * cin <= INPUTS_MAX, "{taps} x {cin} inputs of a value");
        let mut weights = WeightsInt8 {
            taps,
            cin,
            cout,
            data: Aligned::default(),
            scale: scales(plain, cout),
        };
        let rows = taps * weights.tap_rows();
        let mut data = Aligned::zeros(rows * cout.next_multiple_of(LINE));
        for panel in panels(cout) {
            let to = &mut data.as_mut_slice()[panel.first * rows..][..panel.width * rows];
            let taps = to.chunks_exact_mut(weights.tap_rows() * panel.width);
            for (tap, to) in taps.enumerate() {
                weights.pack_tap(&plain[tap * cin * cout..][..cin * cout], panel, to);
            }
        }
        weights.data = data;
        weights
    }

    /// What a sum of 1 is worth in each output channel.
    pub fn scale(&self) -> &[f32] {
        &self.scale
    }

    /// `plain`: `[cin][cout]`. `to`: rows of a tap in one panel.
    fn pack_tap(&self, plain: &[f32], panel: Panel, to: &mut [u32]) {
        let weight = |i: usize, o: usize| {
            if i < self.cin && self.scale[o] > 0.0 {
                (plain[i * self.cout + o] / self.scale[o]).round_ties_even() as i8
            } else {
                0
            }
        };
        for column in 0..panel.used {
            let o = panel.first + column;
            let mut sum = 0;
            for quad in 0..self.cin.div_ceil(4) {
                let four = [0, 1, 2, 3].map(|i| weight(4 * quad + i, o));
                sum += four.iter().map(|&w| i32::from(w)).sum::<i32>();
                to[quad * panel.width + column] = u32::from_ne_bytes(four.map(|w| w as u8));
            }
            to[self.cin.div_ceil(4) * panel.width + column] = (128 * sum) as u32;
        }
    }

    /// Rows of a tap.
    pub(crate) fn tap_rows(&self) -> usize {
        self.cin.div_ceil(4) + 1
    }

    /// `[tap][row][width]` of one panel.
    pub(crate) fn panel(&self, panel: Panel) -> &[u32] {
        let rows = self.taps * self.tap_rows();
        &self.data.as_slice()[panel.first * rows..][..panel.width * rows]
    }
}

/// For each output channel a 127th of its largest weight; 0 where all are 0.
fn scales(plain: &[f32], cout: usize) -> Vec<f32> {
    let mut largest = vec![0.0_f32; cout];
    for row in plain.chunks_exact(cout.max(1)) {
        let pairs = largest.iter_mut().zip(row);
        pairs.for_each(|(largest, weight)| *largest = largest.max(weight.abs()));
    }
    largest.iter().map(|largest| largest / LARGEST).collect()
}
