//! The inner loop of the weight gradient: a tile of sums (input x output channels) held in registers.

use super::{
    LINE, Listed, Pair, Simd,
    cover::{Tile, cover},
};

/// `gradient[i] += input[pair.input][i] * output_gradient[pair.row]`, summed over the pairs, for each input channel `i`.
///
/// `input`: rows of `cin`. `output_gradient`: rows of `width`. `gradient`: `cin` rows of
/// `width`, `stride` values apart.
#[inline(always)]
pub(crate) fn gradient_tiles<S: Simd>(
    simd: S,
    input: &[f32],
    cin: usize,
    listed: Listed,
    output_gradient: &[f32],
    width: usize,
    gradient: &mut [f32],
    stride: usize,
) {
    assert!(width.is_multiple_of(LINE), "rows of {width}");
    listed.check(input.len() / cin, output_gradient.len() / width);
    assert!(width <= stride && gradient.len() >= (cin - 1) * stride + width);
    let tile = Gradient {
        input: input.as_ptr(),
        cin,
        pairs: listed.pairs(),
        output_gradient: output_gradient.as_ptr(),
        width,
        gradient: gradient.as_mut_ptr(),
        stride,
    };
    // SAFETY: the table has a row for each input channel and `width` columns; `check` has seen that every pair points to
    // whole rows of `input` and `output_gradient`, and `gradient` holds `cin` rows of `width` at `stride`.
    unsafe { cover(simd, cin, width, &tile) }
}

struct Gradient<'a> {
    input: *const f32,
    cin: usize,
    pairs: &'a [Pair],
    output_gradient: *const f32,
    width: usize,
    gradient: *mut f32,
    stride: usize,
}

impl Tile for Gradient<'_> {
    #[inline(always)]
    unsafe fn tile<S: Simd, const R: usize, const V: usize>(
        &self,
        simd: S,
        row: usize,
        column: usize,
    ) {
        // SAFETY: `gradient_tiles` has checked the pairs and the lengths, the caller gives rows (input channels) and
        // columns inside.
        unsafe {
            let gradient = self.gradient.add(row * self.stride + column);
            let mut totals = [[simd.splat(0.0); V]; R];
            for r in 0..R {
                for v in 0..V {
                    totals[r][v] = simd.load(gradient.add(r * self.stride + v * S::LANES));
                }
            }
            for pair in self.pairs {
                let input = self.input.add(pair.input as usize * self.cin + row);
                let dy = self
                    .output_gradient
                    .add(pair.row as usize * self.width + column);
                let mut g = [simd.splat(0.0); V];
                for v in 0..V {
                    g[v] = simd.load(dy.add(v * S::LANES));
                }
                for r in 0..R {
                    let x = simd.splat(*input.add(r));
                    for v in 0..V {
                        totals[r][v] = simd.fma(x, g[v], totals[r][v]);
                    }
                }
            }
            for r in 0..R {
                for v in 0..V {
                    simd.store(gradient.add(r * self.stride + v * S::LANES), totals[r][v]);
                }
            }
        }
    }
}
