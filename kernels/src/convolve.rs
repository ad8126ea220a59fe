//! The forward convolution; with transposed weights and gather, also the gradient of its input.

use crate::{
    Bf16, Element, Epilogue, Gather, Level, Weights, WeightsBf16, WeightsInt8, block::Job,
    packed::Packed,
};

/// `output[o] = epilogue(sum over taps t, channels c of input[gather(o, t)][c] * weights[t][c])`.
///
/// `input`: rows of `weights.cin`. `output`: rows of `weights.cout`. `output_rows`: where output row `o` of the gather
/// is written (`None`: at `o`); rows that are not named keep what they hold. Rows in ascending order, the natural one,
/// are written in place; any other order costs one more pass over the result.
///
/// Sums are f32; the output holds f32 or is rounded to bf16, for a layer whose successor multiplies that.
///
/// Runs over rayon's ambient pool; the bits of the result do not depend on the number of threads. Allocates nothing
/// when the rows ascend.
///
/// # Panics
/// When lengths or row numbers contradict each other (a broken invariant, not data).
pub fn convolve<O: Element>(
    input: &[f32],
    gather: &Gather,
    weights: &Weights,
    epilogue: Epilogue,
    output_rows: Option<&[u32]>,
    output: &mut [O],
) {
    convolve_at(
        Level::best(),
        input,
        gather,
        weights,
        epilogue,
        output_rows,
        output,
    );
}

/// [`convolve`] with the registers of `level`, for tests and measurements.
pub fn convolve_at<O: Element>(
    level: Level,
    input: &[f32],
    gather: &Gather,
    weights: &Weights,
    epilogue: Epilogue,
    output_rows: Option<&[u32]>,
    output: &mut [O],
) {
    start(
        Job {
            level,
            input,
            gather,
            weights,
            epilogue,
        },
        output_rows,
        output,
    );
}

/// [`convolve`] on bf16 rows and weights, with sums in f32; the output is bf16 or f32.
///
/// The bits do not depend on the number of threads. They do depend on the processor: some round twice where others
/// round once.
///
/// # Panics
/// As [`convolve`].
pub fn convolve_bf16<O: Element>(
    input: &[Bf16],
    gather: &Gather,
    weights: &WeightsBf16,
    epilogue: Epilogue,
    output_rows: Option<&[u32]>,
    output: &mut [O],
) {
    convolve_bf16_at(
        Level::best(),
        input,
        gather,
        weights,
        epilogue,
        output_rows,
        output,
    );
}

/// [`convolve_bf16`] with the registers of `level`, for tests and measurements.
pub fn convolve_bf16_at<O: Element>(
    level: Level,
    input: &[Bf16],
    gather: &Gather,
    weights: &WeightsBf16,
    epilogue: Epilogue,
    output_rows: Option<&[u32]>,
    output: &mut [O],
) {
    start(
        Job {
            level,
            input,
            gather,
            weights,
            epilogue,
        },
        output_rows,
        output,
    );
}

/// [`convolve`] on rows of bytes and weights in i8, with exact sums in i32; the output is u8, bf16 or f32.
///
/// `epilogue.bias` counts the output's units, as the weights do. Each sum becomes an f32, is multiplied by its channel's
/// scale, then the bias is added: the same bits on every processor and with any number of threads.
///
/// # Panics
/// As [`convolve`].
pub fn convolve_int8<O: Element>(
    input: &[u8],
    gather: &Gather,
    weights: &WeightsInt8,
    epilogue: Epilogue,
    output_rows: Option<&[u32]>,
    output: &mut [O],
) {
    convolve_int8_at(
        Level::best(),
        input,
        gather,
        weights,
        epilogue,
        output_rows,
        output,
    );
}

/// [`convolve_int8`] with the registers of `level`, for tests and measurements.
pub fn convolve_int8_at<O: Element>(
    level: Level,
    input: &[u8],
    gather: &Gather,
    weights: &WeightsInt8,
    epilogue: Epilogue,
    output_rows: Option<&[u32]>,
    output: &mut [O],
) {
    start(
        Job {
            level,
            input,
            gather,
            weights,
            epilogue,
        },
        output_rows,
        output,
    );
}

fn start<W: Packed, O: Element>(job: Job<'_, W>, output_rows: Option<&[u32]>, output: &mut [O]) {
    let (taps, cin, cout) = job.weights.shape();
    let outputs = job.gather.outputs();
    if outputs == 0 || cout == 0 {
        return;
    }
    assert_eq!(job.gather.taps, taps, "taps of gather and weights");
    assert_eq!(
        job.gather.index.len(),
        outputs * taps,
        "gather rows are whole"
    );
    assert!(
        job.input.len().is_multiple_of(cin.max(1)),
        "{} inputs in rows of {cin}",
        job.input.len()
    );
    assert!(
        job.epilogue.bias.is_none_or(|bias| bias.len() == cout),
        "a bias for each of {cout} channels"
    );
    let Some(rows) = output_rows else {
        return job.range(0..outputs, None, 0, &mut output[..outputs * cout]);
    };
    assert_eq!(rows.len(), outputs, "a place for each output row");
    if rows.is_sorted_by(|a, b| a < b) {
        return job.range(0..outputs, Some(rows), 0, output);
    }
    let mut ordered = vec![O::default(); outputs * cout];
    job.range(0..outputs, None, 0, &mut ordered);
    for (row, from) in rows.iter().zip(ordered.chunks_exact(cout)) {
        output[*row as usize * cout..][..cout].copy_from_slice(from);
    }
}
