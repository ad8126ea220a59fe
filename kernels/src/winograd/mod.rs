//! 3x3 layers of stride 1 in tiles of 2x2 outputs: 16 products per tile and pair of channels instead of 36.
//!
//! Winograd's minimal filtering F(2x2, 3x3) (Lavin and Gray 2016, section 4.1): a 4x4 window d of input rows and the kernel g are transformed and
//! multiplied place by place (one matrix product per place sums over input channels), then transformed back: Y = A'[(G g G') * (B' d B)]A. The
//! transforms only add and halve, so the result is the direct one up to rounding. In i16 it is exact: B' d B of values up to 255 lies within 1020,
//! 4 G g G' of weights up to 127 within 1143, and the sums, 4 times the direct sums, fit an i32 for all channels that fit a chunk. An output depends
//! on its own 3x3 inputs alone: the formula cancels the other 7. Rounding does not cancel exactly, and an infinite input may give NaN.

mod tiles;
mod weights;

use crate::{
    Element, Epilogue, Level, Weights,
    simd::{Kernel, Output, PLACES, Simd, TILES_MAX, Tiled, WINDOWS, Windows},
    weights::{PANEL_MAX, panels},
};
use std::{mem::MaybeUninit, ops::Range};

pub use tiles::WinogradTiles;
pub use weights::WeightsWinograd;

/// Chunk sizes are multiples of this, and so of the heights of most register tiles (4, 6, 12).
const CHUNK_STEP: usize = 12;
/// Approximate number of tiles per task: two chunks, so that two threads can share the work of a small scan. A guess.
const TILES_A_TASK: usize = 2 * TILES_MAX;

/// Number of tiles in a chunk whose windows have rows of `cin`; 0 when there is no room for one step of tiles.
fn chunk_tiles(cin: usize) -> usize {
    (WINDOWS / (PLACES * cin)).min(TILES_MAX) / CHUNK_STEP * CHUNK_STEP
}

/// [`crate::convolve`] of a 3x3 layer of stride 1, tile by tile. `level`: the registers to use, mostly [`Level::best`]. `input`: rows of `cin`.
/// `output`: rows of `cout`; rows that no tile names keep their values.
///
/// Runs on rayon's current thread pool; the bits of the result do not depend on the number of threads. Allocates nothing.
///
/// # Panics
/// When lengths or row numbers contradict each other (a broken invariant, not data).
pub fn convolve_winograd<I: Tiled, O: Element>(
    level: Level,
    input: &[I],
    tiles: &WinogradTiles,
    weights: &WeightsWinograd<I>,
    epilogue: Epilogue,
    output: &mut [O],
) {
    let count = tiles.count();
    if count == 0 {
        return;
    }
    let weights = &weights.0;
    epilogue.check(weights.cout);
    Job { level, input, tiles, weights, epilogue }.strips(0..tiles.strips.len(), 0, output);
}

struct Job<'a, I: Tiled> {
    level: Level,
    input: &'a [I],
    tiles: &'a WinogradTiles,
    weights: &'a Weights<I>,
    epilogue: Epilogue<'a>,
}

impl<I: Tiled> Job<'_, I> {
    /// Splits the strips recursively, down to tasks. `output` begins at row `first`.
    fn strips<O: Element>(&self, strips: Range<usize>, first: usize, output: &mut [O]) {
        let tiles = self.tiles.before(strips.start)..self.tiles.before(strips.end);
        if tiles.is_empty() {
            return;
        }
        if tiles.len() <= TILES_A_TASK || strips.len() < 2 {
            return self.task(tiles, first, output);
        }
        let half = tiles.start + tiles.len() / 2;
        let middle = self.tiles.strips[strips.clone()].partition_point(|s| s.tiles_end <= half);
        let middle = (strips.start + middle).clamp(strips.start + 1, strips.end - 1);
        let row = self.tiles.strips[middle - 1].rows_end;
        let (low, high) = output.split_at_mut((row - first) * self.weights.cout);
        rayon::join(
            || self.strips(strips.start..middle, first, low),
            || self.strips(middle..strips.end, row, high),
        );
    }

    /// Computes chunks of tiles, of nearly equal size. Not inlined, so that the stack frames of `strips` do not contain the memory of a chunk.
    #[inline(never)]
    fn task<O: Element>(&self, tiles: Range<usize>, first: usize, output: &mut [O]) {
        let chunks = tiles.len().div_ceil(chunk_tiles(self.weights.cin));
        let size = tiles.len().div_ceil(chunks).next_multiple_of(CHUNK_STEP);
        for start in tiles.clone().step_by(size) {
            self.level.run(Chunk {
                job: self,
                tiles: start..tiles.end.min(start + size),
                first,
                output: &mut *output,
            });
        }
    }
}

/// Tiles whose transformed windows and sums fit the memory of a chunk.
struct Chunk<'a, I: Tiled, O> {
    job: &'a Job<'a, I>,
    tiles: Range<usize>,
    first: usize,
    output: &'a mut [O],
}

impl<I: Tiled, O: Element> Kernel for Chunk<'_, I, O> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let (tiles, weights, epilogue) = (self.job.tiles, self.job.weights, self.job.epilogue);
        let (cin, cout) = (weights.cin, weights.cout);
        let windows = &tiles.inputs[self.tiles.start * PLACES..self.tiles.end * PLACES];
        let mut memory = const { MaybeUninit::uninit() };
        let mut windows = Windows::transformed(simd, &mut memory, self.job.input, cin, windows);
        for panel in panels(cout) {
            let mut bias = [0.0; PANEL_MAX];
            if let Some(values) = epilogue.bias {
                bias[..panel.used].copy_from_slice(&values[panel.first..][..panel.used]);
            }
            let channels = panel.first..panel.first + panel.width;
            let factors = (&weights.scale()[channels.clone()], &bias[..panel.width]);
            let rows = &tiles.outputs[self.tiles.start * 4..self.tiles.end * 4];
            let mut to = Output {
                values: &mut *self.output,
                first_row: self.first,
                channels: cout,
                columns: channels,
                floor: epilogue.floor(),
            };
            windows.panel(self.job.level, simd, weights.panel(panel), factors, rows, &mut to);
        }
    }
}
