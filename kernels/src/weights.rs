//! Weights in the order the kernels read them.

use crate::simd::{Aligned, LINE};

/// Most output channels of one panel: four AVX-512 registers.
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
        let panel = Panel {
            first,
            width,
            used: width.min(cout - first),
        };
        first += width;
        panel
    })
}

/// Weights of one convolution, packed: panels of up to 64 output channels, each `[tap][cin][width]`, 64-byte aligned,
/// channels padded to a multiple of 16 with zeros.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Weights {
    /// Taps of the kernel; equal to those of the gather.
    pub taps: usize,
    /// Channels of an input row.
    pub cin: usize,
    /// Channels of an output row.
    pub cout: usize,
    data: Aligned<f32>,
}

impl Weights {
    /// Packs `[tap][cin][cout]`.
    ///
    /// # Panics
    /// When `plain` has another length (a broken invariant, not data).
    pub fn pack(taps: usize, cin: usize, cout: usize, plain: &[f32]) -> Weights {
        assert_eq!(
            plain.len(),
            taps * cin * cout,
            "weights of {taps} x {cin} x {cout}"
        );
        Weights::from_fn(taps, cin, cout, |tap, i, o| {
            plain[(tap * cin + i) * cout + o]
        })
    }

    /// Packs the transpose of `[tap][cin][cout]`, for the input gradient: rows of `cout` in, rows of `cin` out.
    ///
    /// # Panics
    /// When `plain` has another length (a broken invariant, not data).
    pub fn pack_transposed(taps: usize, cin: usize, cout: usize, plain: &[f32]) -> Weights {
        assert_eq!(
            plain.len(),
            taps * cin * cout,
            "weights of {taps} x {cin} x {cout}"
        );
        Weights::from_fn(taps, cout, cin, |tap, i, o| {
            plain[(tap * cin + o) * cout + i]
        })
    }

    fn from_fn(
        taps: usize,
        cin: usize,
        cout: usize,
        weight: impl Fn(usize, usize, usize) -> f32,
    ) -> Weights {
        let mut data = Aligned::zeros(taps * cin * cout.next_multiple_of(LINE));
        let values = data.as_mut_slice();
        for panel in panels(cout) {
            for row in 0..taps * cin {
                let to = &mut values[panel.first * taps * cin + row * panel.width..][..panel.used];
                for (o, to) in to.iter_mut().enumerate() {
                    *to = weight(row / cin, row % cin, panel.first + o);
                }
            }
        }
        Weights {
            taps,
            cin,
            cout,
            data,
        }
    }

    /// `[tap][cin][width]` of one panel.
    pub(crate) fn panel(&self, panel: Panel) -> &[f32] {
        let rows = self.taps * self.cin;
        &self.data.as_slice()[panel.first * rows..][..panel.width * rows]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panels_cover_all_channels_once() {
        for cout in 1..=300 {
            let panels: Vec<_> = panels(cout).collect();
            assert_eq!(panels[0].first, 0);
            assert!(
                panels
                    .windows(2)
                    .all(|two| two[1].first == two[0].first + two[0].width)
            );
            assert!(
                panels
                    .iter()
                    .all(|p| p.width % LINE == 0 && (LINE..=PANEL_MAX).contains(&p.width))
            );
            assert_eq!(panels.iter().map(|p| p.used).sum::<usize>(), cout);
        }
    }

    #[test]
    fn widths_are_even() {
        let widths = |cout| panels(cout).map(|p| p.width).collect::<Vec<_>>();
        assert_eq!(widths(96), [48, 48]);
        assert_eq!(widths(84), [48, 48]);
        assert_eq!(widths(128), [64, 64]);
        assert_eq!(widths(72), [48, 32]);
    }

    #[test]
    fn transposed_twice_is_the_same() {
        let plain: Vec<f32> = (0..9 * 5 * 18).map(|x| x as f32).collect();
        let mut turned = vec![0.0; plain.len()];
        for tap in 0..9 {
            for i in 0..5 {
                for o in 0..18 {
                    turned[(tap * 18 + o) * 5 + i] = plain[(tap * 5 + i) * 18 + o];
                }
            }
        }
        assert_eq!(
            Weights::pack(9, 5, 18, &plain),
            Weights::pack_transposed(9, 18, 5, &turned)
        );
    }
}
