//! The plain version that every faster one is tested against.

use crate::{ABSENT, Epilogue, Gather, Weights};

/// `output[o] = epilogue(sum over taps t, channels c of input[gather(o, t)][c] * weights[t][c])`.
///
/// `input`: rows of `weights.cin`. `output`: rows of `weights.cout`. `output_rows`: where output row `o` of the gather
/// is written; `None`: at `o`.
pub fn convolve(
    input: &[f32],
    gather: &Gather,
    weights: &Weights,
    epilogue: Epilogue,
    output_rows: Option<&[u32]>,
    output: &mut [f32],
) {
    let (cin, cout) = (weights.cin, weights.cout);
    for (o, taps) in gather.index.chunks_exact(gather.taps).enumerate() {
        let to = output_rows.map_or(o, |rows| rows[o] as usize);
        let out = &mut output[to * cout..(to + 1) * cout];
        match epilogue.bias {
            Some(bias) => out.copy_from_slice(bias),
            None => out.fill(0.0),
        }
        for (tap, &row) in taps.iter().enumerate().filter(|(_, row)| **row != ABSENT) {
            let input = &input[row as usize * cin..][..cin];
            for (c, &x) in input.iter().enumerate() {
                let w = &weights.data[(tap * cin + c) * weights.cout_padded..][..cout];
                for (y, &w) in out.iter_mut().zip(w) {
                    *y += x * w;
                }
            }
        }
        if epilogue.relu {
            out.iter_mut().for_each(|y| *y = y.max(0.0));
        }
    }
}

/// `gradient[t][i][o] += sum over output rows r of input[gather(r, t)][i] * output_gradient[r][o]`.
///
/// `input`: rows of `cin`; `output_gradient`: rows of `cout`; `gradient`: `taps * cin * cout`.
pub fn weight_gradient(
    input: &[f32],
    cin: usize,
    gather: &Gather,
    output_gradient: &[f32],
    cout: usize,
    gradient: &mut [f32],
) {
    for (taps, dy) in gather.index.chunks_exact(gather.taps).zip(output_gradient.chunks_exact(cout)) {
        for (tap, &row) in taps.iter().enumerate().filter(|(_, row)| **row != ABSENT) {
            let input = &input[row as usize * cin..][..cin];
            for (c, &x) in input.iter().enumerate() {
                let g = &mut gradient[(tap * cin + c) * cout..][..cout];
                for (g, &dy) in g.iter_mut().zip(dy) {
                    *g += x * dy;
                }
            }
        }
    }
}
