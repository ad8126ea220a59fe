//! The transforms and products of Winograd's F(2x2, 3x3) in registers, and the memory between them.

use std::{marker::PhantomData, mem::MaybeUninit, ops::Range};

use super::{
    AlignedArray, LINE, Simd, clamp,
    cover::{Tile, cover},
    load,
    operand::multiply,
    store,
    tiles::store_tile,
};
use crate::{ABSENT, weights::PANEL_MAX, winograd::PLACES};

/// Room for a chunk of tiles: transformed windows `[place][tile][cin]` and sums `[place][tile][width]`.
pub(crate) struct WinogradMemory {
    windows: AlignedArray<f32, { WinogradMemory::WINDOWS }>,
    sums: AlignedArray<f32, { WinogradMemory::SUMS }>,
}

impl WinogradMemory {
    /// Values of transformed windows that have room: 384 KiB, all of a chunk for 128 channels and a step of one for 512.
    pub(crate) const WINDOWS: usize = 96 * 1024;
    /// With its sums such a chunk fits a second-level cache of 1 MiB. Measured: chunks of 24 and 16 are slower.
    pub(crate) const TILES_MAX: usize = 48;
    const SUMS: usize = PLACES * WinogradMemory::TILES_MAX * PANEL_MAX;
}

/// Where the outputs of a panel go.
pub(crate) struct Output<'a> {
    /// Rows of `channels`, from row `first_row` of the map on.
    pub(crate) values: &'a mut [f32],
    /// Rows of tiles count from the map's begin.
    pub(crate) first_row: usize,
    /// Of a row.
    pub(crate) channels: usize,
    /// Channels of the panel.
    pub(crate) columns: Range<usize>,
    /// What no output is below.
    pub(crate) floor: f32,
}

/// The transformed windows of a chunk of tiles.
pub(crate) struct Windows<'a> {
    /// `tiles` rows of `cin` at each place are initialised.
    windows: *const f32,
    /// Room for [`WinogradMemory::SUMS`].
    sums: *mut f32,
    tiles: usize,
    cin: usize,
    memory: PhantomData<&'a mut WinogradMemory>,
}

impl<'a> Windows<'a> {
    /// B' d B of each window d. `input`: rows of `cin`; `windows`: 16 rows of it a tile. `memory` need not be initialised:
    /// it is larger than a stack would like to hold twice.
    #[inline(always)]
    pub(crate) fn transformed<S: Simd>(
        simd: S,
        memory: &'a mut MaybeUninit<WinogradMemory>,
        input: &[f32],
        cin: usize,
        windows: &[u32],
    ) -> Windows<'a> {
        let tiles = windows.len() / PLACES;
        let values = PLACES * tiles * cin;
        assert!(cin.is_multiple_of(S::LANES), "rows of {cin}");
        let fits = values <= WinogradMemory::WINDOWS && tiles <= WinogradMemory::TILES_MAX;
        assert!(fits, "{tiles} tiles, rows of {cin}");
        // ABSENT + 1 is 0.
        let ends = windows.iter().map(|row| row.wrapping_add(1));
        let (end, inputs) = (ends.fold(0, u32::max), input.len() / cin);
        let last = end.wrapping_sub(1);
        assert!(end as usize <= inputs, "input row {last} of {inputs}");
        let memory = memory.as_mut_ptr();
        // SAFETY: both are fields of `memory`; nothing is read.
        let (to, sums) = unsafe { (&raw mut (*memory).windows, &raw mut (*memory).sums) };
        let to: *mut f32 = to.cast();
        for (tile, rows) in windows.chunks_exact(PLACES).enumerate() {
            let mut channel = 0;
            while channel < cin {
                let mut d = [[simd.splat(0.0); 4]; 4];
                for y in 0..4 {
                    for x in 0..4 {
                        let row = rows[4 * y + x];
                        if row != ABSENT {
                            // SAFETY: a row that is not absent lies in `input` (`end`), and LANES channels from
                            // `channel` on lie in it, because cin is a multiple of LANES.
                            d[y][x] =
                                unsafe { load(input.as_ptr().add(row as usize * cin + channel)) };
                        }
                    }
                }
                let d = transposed(window_lines(simd, d));
                let d = window_lines(simd, d);
                for y in 0..4 {
                    for x in 0..4 {
                        let place = ((y * 4 + x) * tiles + tile) * cin + channel;
                        // SAFETY: place + LANES <= 16 tiles cin = `values`, which `windows` has room for.
                        unsafe { store(to.add(place), d[x][y]) };
                    }
                }
                channel += S::LANES;
            }
        }
        Windows {
            windows: to,
            sums: sums.cast(),
            tiles,
            cin,
            memory: PhantomData,
        }
    }

    /// The outputs of a panel: windows times weights at each place, transformed back, the bias added. `weights`:
    /// `[place][cin][width]`; `bias`: `width` values; `rows`: 4 of the map a tile.
    #[inline(always)]
    pub(crate) fn panel<S: Simd>(
        &mut self,
        simd: S,
        weights: &[f32],
        bias: Option<&[f32]>,
        rows: &[u32],
        output: &mut Output,
    ) {
        let width = output.columns.len();
        assert!(
            width.is_multiple_of(LINE)
                && width <= PANEL_MAX
                && output.columns.end <= output.channels
        );
        assert_eq!(weights.len(), PLACES * self.cin * width);
        assert_eq!(rows.len(), 4 * self.tiles, "rows of {} tiles", self.tiles);
        assert!(
            bias.is_none_or(|bias| bias.len() == width),
            "a bias a channel"
        );
        self.multiply(simd, weights, width);
        self.transform_back(simd, bias, rows, output);
    }

    /// A part of [`Windows::panel`], which has checked the lengths.
    #[inline(always)]
    fn multiply<S: Simd>(&mut self, simd: S, weights: &[f32], width: usize) {
        for place in 0..PLACES {
            // SAFETY: the first of `tiles` rows of `cin`, and of as many rows of `width` that have room.
            let (windows, sums) = unsafe {
                (
                    self.windows.add(place * self.tiles * self.cin),
                    self.sums.add(place * self.tiles * width),
                )
            };
            let product = Product {
                windows,
                cin: self.cin,
                weights: weights[place * self.cin * width..].as_ptr(),
                width,
                sums,
            };
            // SAFETY: `transformed` has written `tiles` rows of `cin` at each place, `weights` has `cin` rows of
            // `width`, and `sums` has room for TILES_MAX >= tiles rows of PANEL_MAX >= width at each.
            unsafe { cover(simd, self.tiles, width, &product) }
        }
    }

    /// A' m A of the sums m of each tile; a part of [`Windows::panel`], which has just multiplied.
    #[inline(always)]
    fn transform_back<S: Simd>(
        &self,
        simd: S,
        bias: Option<&[f32]>,
        rows: &[u32],
        output: &mut Output,
    ) {
        let (tiles, width) = (self.tiles, output.columns.len());
        let one = simd.splat(1.0);
        for (tile, rows) in rows.chunks_exact(4).enumerate() {
            let mut channel = 0;
            while channel < width {
                let mut m = [[simd.splat(0.0); 4]; 4];
                for y in 0..4 {
                    for x in 0..4 {
                        let place = ((y * 4 + x) * tiles + tile) * width + channel;
                        // SAFETY: `multiply` has written `width` sums of each of the tiles at each place; width is a
                        // multiple of LANES.
                        m[y][x] = unsafe { load(self.sums.add(place)) };
                    }
                }
                let [upper, lower] = output_lines(simd, m);
                let m = transposed([upper, lower, upper, lower]);
                let m = output_lines(simd, m);
                let mut added = simd.splat(0.0);
                if let Some(bias) = bias {
                    // SAFETY: the bias has `width` values.
                    added = unsafe { load(bias.as_ptr().add(channel)) };
                }
                for y in 0..2 {
                    for x in 0..2 {
                        let row = rows[2 * y + x];
                        if row == ABSENT {
                            continue;
                        }
                        // A row before the first one wraps to where no slice reaches.
                        let row = (row as usize).wrapping_sub(output.first_row);
                        let from = row.wrapping_mul(output.channels);
                        let from = from.wrapping_add(output.columns.start + channel);
                        let to = &mut output.values[from..][..S::LANES];
                        // SAFETY: `to` has LANES values.
                        unsafe { store(to.as_mut_ptr(), simd.fma(m[x][y], one, added)) };
                        for value in to {
                            *value = clamp(*value, output.floor);
                        }
                    }
                }
                channel += S::LANES;
            }
        }
    }
}

/// B' d: differences and sums of the rows of a window.
#[inline(always)]
fn window_lines<S: Simd>(simd: S, d: [[S::Vector; 4]; 4]) -> [[S::Vector; 4]; 4] {
    let (one, minus) = (simd.splat(1.0), simd.splat(-1.0));
    let mut lines = d;
    for x in 0..4 {
        lines[0][x] = simd.fma(d[2][x], minus, d[0][x]);
        lines[1][x] = simd.fma(d[1][x], one, d[2][x]);
        lines[2][x] = simd.fma(d[1][x], minus, d[2][x]);
        lines[3][x] = simd.fma(d[3][x], minus, d[1][x]);
    }
    lines
}

/// A' m: sums and differences of the rows of a tile's sums.
#[inline(always)]
fn output_lines<S: Simd>(simd: S, m: [[S::Vector; 4]; 4]) -> [[S::Vector; 4]; 2] {
    let (one, minus) = (simd.splat(1.0), simd.splat(-1.0));
    let mut lines = [m[0], m[1]];
    for x in 0..4 {
        let (outer, inner) = (
            simd.fma(m[0][x], one, m[1][x]),
            simd.fma(m[2][x], minus, m[1][x]),
        );
        lines[0][x] = simd.fma(m[2][x], one, outer);
        lines[1][x] = simd.fma(m[3][x], minus, inner);
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
struct Product {
    windows: *const f32,
    cin: usize,
    weights: *const f32,
    width: usize,
    sums: *mut f32,
}

impl Tile for Product {
    #[inline(always)]
    unsafe fn tile<S: Simd, const R: usize, const V: usize>(
        &self,
        simd: S,
        row: usize,
        column: usize,
    ) {
        // SAFETY: `Windows::multiply` has checked the lengths, the caller gives rows and columns inside.
        unsafe {
            let (mut windows, mut sums) = ([self.windows; R], [self.sums; R]);
            for r in 0..R {
                windows[r] = self.windows.add((row + r) * self.cin);
                sums[r] = self.sums.add((row + r) * self.width + column);
            }
            let mut totals = [[simd.splat(0.0); V]; R];
            let weights = self.weights.add(column);
            multiply(simd, windows, self.cin, weights, self.width, &mut totals);
            store_tile::<f32, S, R, V>(sums, totals);
        }
    }
}
