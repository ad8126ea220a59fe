//! The transforms and products of Winograd's F(2x2, 3x3) in registers, and the memory between them.

use super::{
    AlignedArray, Element, Kernel, LINE, Level, Simd, Sum, clamp,
    cover::{Tile, cover},
    load,
    operand::multiply,
    store,
    tiles::store_tile,
};
use crate::{ABSENT, weights::PANEL_MAX};
use std::{marker::PhantomData, mem::MaybeUninit, ops::Range};

/// A type of values that a layer by Winograd tiles can multiply.
pub trait Tiled: Element {
    /// Multiplies the windows of a chunk.
    fn multiply_windows(level: Level, products: WindowProducts<Self>);

    /// Transformed weights are G g G' times this factor, which makes them integers where the weights are integers.
    const WEIGHT_FACTOR: f32;

    /// `a + b` of values, `a - b` with `MINUS`.
    fn add<S: Simd, const MINUS: bool>(
        simd: S,
        a: Self::Factor<S>,
        b: Self::Factor<S>,
    ) -> Self::Factor<S>;

    /// [`Tiled::add`] of sums.
    fn add_sums<S: Simd, const MINUS: bool>(
        simd: S,
        a: Self::Total<S>,
        b: Self::Total<S>,
    ) -> Self::Total<S>;
}

impl Tiled for f32 {
    compiled_here!(multiply_windows(WindowProducts));
    const WEIGHT_FACTOR: f32 = 1.0;

    #[inline(always)]
    fn add<S: Simd, const MINUS: bool>(simd: S, a: S::Vector, b: S::Vector) -> S::Vector {
        simd.fma(b, simd.splat(if MINUS { -1.0 } else { 1.0 }), a)
    }

    #[inline(always)]
    fn add_sums<S: Simd, const MINUS: bool>(simd: S, a: S::Vector, b: S::Vector) -> S::Vector {
        f32::add::<S, MINUS>(simd, a, b)
    }
}

impl Tiled for i16 {
    compiled_here!(multiply_windows(WindowProducts));
    const WEIGHT_FACTOR: f32 = 4.0;

    #[inline(always)]
    fn add<S: Simd, const MINUS: bool>(simd: S, a: S::Bits, b: S::Bits) -> S::Bits {
        if MINUS { simd.sub_shorts(a, b) } else { simd.add_shorts(a, b) }
    }

    #[inline(always)]
    fn add_sums<S: Simd, const MINUS: bool>(simd: S, a: S::Bits, b: S::Bits) -> S::Bits {
        if MINUS { simd.sub_bits(a, b) } else { simd.add_bits(a, b) }
    }
}

/// Input rows of a tile's window, and places of the transformed product.
pub(crate) const PLACES: usize = 16;
/// Room for transformed windows, in values: 384 KiB in f32; a whole chunk with 128 channels, or one step of a chunk with 512.
pub(crate) const WINDOWS: usize = 96 * 1024;
/// Maximum number of tiles in a chunk: with its sums it fits a second-level cache of 1 MiB. Measured: chunks of 24 and 16 are slower.
pub(crate) const TILES_MAX: usize = 48;
const SUMS: usize = PLACES * TILES_MAX * PANEL_MAX;

/// Room for a chunk of tiles: transformed windows `[place][tile][cin]` and sums `[place][tile][width]`.
pub(crate) struct WinogradMemory<I: Tiled> {
    windows: AlignedArray<I, WINDOWS>,
    sums: AlignedArray<I::Sum, SUMS>,
}

/// Where the outputs of a panel are written.
pub(crate) struct Output<'a, O> {
    /// Rows of `channels`, from row `first_row` of the map on.
    pub(crate) values: &'a mut [O],
    /// The first row of `values` in the map. Tiles name rows of the whole map.
    pub(crate) first_row: usize,
    /// Number of channels of a row.
    pub(crate) channels: usize,
    /// Channels of the panel.
    pub(crate) columns: Range<usize>,
    /// The lower bound of the outputs.
    pub(crate) floor: f32,
}

/// The transformed windows of a chunk of tiles.
pub(crate) struct Windows<'a, I: Tiled> {
    /// At each place, `tiles` rows of `cin` values are initialised.
    windows: *const I,
    /// Room for [`SUMS`] values.
    sums: *mut I::Sum,
    tiles: usize,
    cin: usize,
    memory: PhantomData<&'a mut WinogradMemory<I>>,
}

impl<'a, I: Tiled> Windows<'a, I> {
    /// Computes B' d B of each window d. `input`: rows of `cin`; `windows`: 16 input rows per tile. `memory` may be
    /// uninitialised: it is too large to be on the stack twice.
    #[inline(always)]
    pub(crate) fn transformed<S: Simd>(
        simd: S,
        memory: &'a mut MaybeUninit<WinogradMemory<I>>,
        input: &[I],
        cin: usize,
        windows: &[u32],
    ) -> Windows<'a, I> {
        let tiles = windows.len() / PLACES;
        let values = PLACES * tiles * cin;
        let lanes = S::LANES * I::STEP;
        assert!(cin >= lanes, "rows of {cin}");
        assert!(values <= WINDOWS && tiles <= TILES_MAX, "{tiles} tiles, rows of {cin}");
        // ABSENT + 1 is 0.
        let ends = windows.iter().map(|row| row.wrapping_add(1));
        let (end, inputs) = (ends.fold(0, u32::max), input.len() / cin);
        let last = end.wrapping_sub(1);
        assert!(end as usize <= inputs, "input row {last} of {inputs}");
        let memory = memory.as_mut_ptr();
        // SAFETY: both are fields of `memory`; nothing is read.
        let (to, sums) = unsafe { (&raw mut (*memory).windows, &raw mut (*memory).sums) };
        let to: *mut I = to.cast();
        // SAFETY: a step has at most 4 values.
        let zero = unsafe { I::splat(simd, [I::default(); 4].as_ptr()) };
        for (tile, rows) in windows.chunks_exact(PLACES).enumerate() {
            for channel in (0..cin).step_by(lanes) {
                // The last register may repeat channels of the register before it.
                let channel = channel.min(cin - lanes);
                let mut d = [[zero; 4]; 4];
                for y in 0..4 {
                    for x in 0..4 {
                        let row = rows[4 * y + x];
                        if row != ABSENT {
                            // SAFETY: a row that is not absent lies in `input` (`end`), and a register of channels
                            // from `channel` on lies in the row, because `channel` + lanes <= cin.
                            d[y][x] =
                                unsafe { load(input.as_ptr().add(row as usize * cin + channel)) };
                        }
                    }
                }
                let d = transposed(window_lines::<I, S>(simd, d));
                let d = window_lines::<I, S>(simd, d);
                for y in 0..4 {
                    for x in 0..4 {
                        let place = ((y * 4 + x) * tiles + tile) * cin + channel;
                        // SAFETY: place + lanes <= 16 tiles cin = `values`, and `windows` has room for `values`.
                        unsafe { store(to.add(place), d[x][y]) };
                    }
                }
            }
        }
        Windows { windows: to, sums: sums.cast(), tiles, cin, memory: PhantomData }
    }

    /// Computes the outputs of a panel: windows times weights at each place, transformed back, scaled, the bias added.
    /// `weights`: `[place][row][width]`; `scale` and `bias`: `width` values; `rows`: 4 rows of the map per tile.
    #[inline(always)]
    pub(crate) fn panel<S: Simd, O: Element>(
        &mut self,
        level: Level,
        simd: S,
        weights: &[I::Weight],
        (scale, bias): (&[f32], &[f32]),
        rows: &[u32],
        output: &mut Output<O>,
    ) {
        let width = output.columns.len();
        assert!(width.is_multiple_of(LINE) && width <= PANEL_MAX);
        assert!(output.columns.end <= output.channels);
        assert_eq!(weights.len(), PLACES * I::tap_rows(self.cin) * width);
        assert_eq!(rows.len(), 4 * self.tiles, "rows of {} tiles", self.tiles);
        assert!(scale.len() == width && bias.len() == width);
        let products = WindowProducts { windows: self, weights, width };
        I::multiply_windows(level, products);
        self.transform_back(simd, (scale, bias), rows, output);
    }

    /// Computes A' m A of the sums m of each tile; a part of [`Windows::panel`], which has called `multiply_windows` before.
    #[inline(always)]
    fn transform_back<S: Simd, O: Element>(
        &self,
        simd: S,
        (scale, bias): (&[f32], &[f32]),
        rows: &[u32],
        output: &mut Output<O>,
    ) {
        let (tiles, width) = (self.tiles, output.columns.len());
        let mut sums = AlignedArray([I::Sum::default(); 4 * PANEL_MAX]);
        for (tile, rows) in rows.chunks_exact(4).enumerate() {
            for channel in (0..width).step_by(S::LANES) {
                // SAFETY: the first values that `multiply_windows` has written.
                let mut m = [[unsafe { load(self.sums) }; 4]; 4];
                for y in 0..4 {
                    for x in 0..4 {
                        let place = ((y * 4 + x) * tiles + tile) * width + channel;
                        // SAFETY: `multiply_windows` has written `width` sums of each of the tiles at each place; width is a multiple of LANES.
                        m[y][x] = unsafe { load(self.sums.add(place)) };
                    }
                }
                let [upper, lower] = output_lines::<I, S>(simd, m);
                let m = transposed([upper, lower, upper, lower]);
                let m = output_lines::<I, S>(simd, m);
                for y in 0..2 {
                    for x in 0..2 {
                        let to = &mut sums.0[(2 * y + x) * PANEL_MAX + channel..][..S::LANES];
                        // SAFETY: `to` has LANES values.
                        unsafe { store(to.as_mut_ptr(), m[x][y]) };
                    }
                }
            }
            for (row, sums) in rows.iter().zip(sums.0.chunks_exact(PANEL_MAX)) {
                if *row == ABSENT {
                    continue;
                }
                // A row before the first one wraps to an index beyond every slice.
                let row = (*row as usize).wrapping_sub(output.first_row);
                let from = row.wrapping_mul(output.channels);
                let from = from.wrapping_add(output.columns.start);
                let to = &mut output.values[from..][..width];
                let channels = sums.iter().zip(scale).zip(bias);
                for (y, ((sum, scale), bias)) in to.iter_mut().zip(channels) {
                    let value = sum.finish(*scale, 0.0) + bias;
                    *y = O::from_f32(clamp(value, output.floor));
                }
            }
        }
    }
}

/// The products of a chunk's windows and a panel's weights; a part of [`Windows::panel`], which has checked the lengths.
pub struct WindowProducts<'a, 'b, I: Tiled> {
    windows: &'a mut Windows<'b, I>,
    weights: &'a [I::Weight],
    width: usize,
}

impl<I: Tiled> Kernel for WindowProducts<'_, '_, I> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Windows { tiles, cin, .. } = *self.windows;
        let width = self.width;
        let size = I::tap_rows(cin) * width;
        for place in 0..PLACES {
            // SAFETY: inside the memory: the first of `tiles` rows of `cin`, and the first of `tiles` rows of `width`.
            let (windows, sums) = unsafe {
                (
                    self.windows.windows.add(place * tiles * cin),
                    self.windows.sums.add(place * tiles * width),
                )
            };
            let product = Product::<I> {
                windows,
                cin,
                weights: self.weights[place * size..].as_ptr(),
                width,
                sums,
            };
            // SAFETY: `transformed` has written `tiles` rows of `cin` at each place, `weights` has their rows of
            // `width`, and `sums` has room for TILES_MAX >= tiles rows of PANEL_MAX >= width at each.
            unsafe { cover(simd, tiles, width, &product) }
        }
    }
}

/// B' d: differences and sums of the rows of a window.
#[inline(always)]
fn window_lines<I: Tiled, S: Simd>(simd: S, d: [[I::Factor<S>; 4]; 4]) -> [[I::Factor<S>; 4]; 4] {
    let mut lines = d;
    for x in 0..4 {
        lines[0][x] = I::add::<S, true>(simd, d[0][x], d[2][x]);
        lines[1][x] = I::add::<S, false>(simd, d[1][x], d[2][x]);
        lines[2][x] = I::add::<S, true>(simd, d[2][x], d[1][x]);
        lines[3][x] = I::add::<S, true>(simd, d[1][x], d[3][x]);
    }
    lines
}

/// A' m: sums and differences of the rows of a tile's sums.
#[inline(always)]
fn output_lines<I: Tiled, S: Simd>(simd: S, m: [[I::Total<S>; 4]; 4]) -> [[I::Total<S>; 4]; 2] {
    let mut lines = [m[0], m[1]];
    for x in 0..4 {
        let outer = I::add_sums::<S, false>(simd, m[0][x], m[1][x]);
        let inner = I::add_sums::<S, true>(simd, m[1][x], m[2][x]);
        lines[0][x] = I::add_sums::<S, false>(simd, m[2][x], outer);
        lines[1][x] = I::add_sums::<S, true>(simd, inner, m[3][x]);
    }
    lines
}

#[inline(always)]
fn transposed<V: Copy>(m: [[V; 4]; 4]) -> [[V; 4]; 4] {
    let mut turned = m;
    for y in 0..4 {
        for x in 0..4 {
            turned[y][x] = m[x][y];
        }
    }
    turned
}

/// Rows of windows times a matrix of weights, at one place.
struct Product<I: Tiled> {
    windows: *const I,
    cin: usize,
    weights: *const I::Weight,
    width: usize,
    sums: *mut I::Sum,
}

impl<I: Tiled> Tile for Product<I> {
    #[inline(always)]
    unsafe fn tile<S: Simd, const R: usize, const V: usize>(&self, simd: S, at: [usize; 2]) {
        let [row, column] = at;
        // SAFETY: `Windows::panel` has checked the lengths; the caller gives rows and columns inside; a register has at most LINE lanes.
        unsafe {
            let (mut windows, mut sums) = ([self.windows; R], [self.sums; R]);
            for r in 0..R {
                windows[r] = self.windows.add((row + r) * self.cin);
                sums[r] = self.sums.add((row + r) * self.width + column);
            }
            let mut totals = [[load([I::Sum::default(); LINE].as_ptr()); V]; R];
            let weights = self.weights.add(column);
            multiply(simd, windows, self.cin, weights, self.width, &mut totals);
            store_tile::<I, S, R, V>(sums, totals);
        }
    }
}
