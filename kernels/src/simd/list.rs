//! The rows of a block that have an input row, tap by tap.

use std::{marker::PhantomData, mem::MaybeUninit};

use super::Simd;
use crate::ABSENT;

/// An input row and the row of the block that it meets at a tap.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub(super) struct Pair {
    /// Row of the input.
    pub(super) input: u32,
    /// Row of the block: of its sums (forward) or of its output gradients.
    pub(super) row: u32,
}

/// Rows of a block: its sums (at most 64 channels) fill three quarters of a first-level cache of 32 KiB. A multiple of
/// all tile heights (6, 8, 12), so that a block without absent rows is covered by tall tiles.
pub(crate) const BLOCK: usize = 96;

/// Taps that are listed at once: as many as a register of AVX-512 holds.
pub(super) const GROUP: usize = 16;

/// A register of pairs is written whole, and kept as far as it counts.
const SLACK: usize = 8;

/// The pairs of one block of rows, for [`GROUP`] taps at a time.
///
/// What [`Simd::list`] writes is what safe code relies on: `counts`, `inputs`, and rows of pairs among the block's.
pub struct Lists<'a> {
    /// The input row of each row of the block and each tap.
    pub(super) index: &'a [u32],
    pub(super) taps: usize,
    /// Of the block; at most [`BLOCK`].
    pub(super) rows: usize,
    pub(super) pairs: [[MaybeUninit<Pair>; BLOCK + SLACK]; GROUP],
    /// Pairs at each tap of the group; so many are initialised.
    pub(super) counts: [usize; GROUP],
    /// Every listed input row is below this.
    pub(super) inputs: usize,
    /// First tap of the group that is listed.
    held: Option<usize>,
}

/// The pairs of one tap, or of several in a row that have all rows of the block; and what they stay below.
#[derive(Clone, Copy)]
pub(crate) struct Listed<'a> {
    /// Of the first tap; `taps` times as many as [`Listed::pairs`] can be read from there on.
    pub(super) first: *const Pair,
    /// At each tap.
    count: usize,
    taps: usize,
    inputs: usize,
    rows: usize,
    lists: PhantomData<&'a Lists<'a>>,
}

impl Lists<'_> {
    /// `index`: rows of `taps`, at most [`BLOCK`].
    #[inline(always)]
    pub(crate) fn new(index: &[u32], taps: usize) -> Lists<'_> {
        let entries = index.len();
        let fits = entries <= BLOCK * taps && entries.is_multiple_of(taps);
        assert!(fits, "{entries} entries of {taps} taps");
        Lists {
            index,
            taps,
            rows: entries / taps,
            pairs: [[const { MaybeUninit::uninit() }; BLOCK + SLACK]; GROUP],
            counts: [0; GROUP],
            inputs: 0,
            held: None,
        }
    }

    /// The rows present at `tap`, ascending.
    #[inline(always)]
    pub(crate) fn at_tap<S: Simd>(&mut self, simd: S, tap: usize) -> Listed<'_> {
        assert!(tap < self.taps, "tap {tap} of {}", self.taps);
        let first = tap / GROUP * GROUP;
        if self.held != Some(first) {
            simd.list(self, first);
            self.held = Some(first);
        }
        let tap = tap - first;
        Listed {
            first: self.pairs[tap..].as_ptr().cast(),
            count: self.counts[tap],
            taps: 1,
            inputs: self.inputs,
            rows: self.rows,
            lists: PhantomData,
        }
    }

    /// [`Lists::at_tap`], with as many taps after it as are listed and, like it, have every row: their sums can stay in registers from tap to tap.
    #[inline(always)]
    pub(crate) fn at_taps_from<S: Simd>(&mut self, simd: S, tap: usize) -> Listed<'_> {
        self.at_tap(simd, tap);
        let (rows, place) = (self.rows, tap % GROUP);
        let last = GROUP.min(self.taps - (tap - place));
        let counts = self.counts[place..last].iter();
        let full = counts.take_while(|count| **count == rows);
        Listed {
            taps: full.count().max(1),
            ..self.at_tap(simd, tap)
        }
    }

    /// What [`Simd::list`] does, on any processor.
    #[inline(always)]
    pub(super) fn list_plain(&mut self, first: usize) {
        if self.held.is_none() {
            // ABSENT + 1 is 0.
            let ends = self.index.iter().map(|input| input.wrapping_add(1));
            self.inputs = ends.fold(0, u32::max) as usize;
        }
        let lists = self.pairs.iter_mut().zip(&mut self.counts);
        for (tap, (pairs, counted)) in (first..self.taps).zip(lists) {
            let mut count = 0;
            for row in 0..self.rows {
                // SAFETY: `new` has seen `rows` rows of `taps` entries, BLOCK at most; `count` is not above `row`.
                let (input, pair) = unsafe {
                    let input = *self.index.get_unchecked(row * self.taps + tap);
                    (input, pairs.get_unchecked_mut(count))
                };
                // Always written, kept when present: no branch to mispredict.
                let row = row as u32;
                pair.write(Pair { input, row });
                count += usize::from(input != ABSENT);
            }
            *counted = count;
        }
    }
}

impl Listed<'_> {
    /// Of the first tap.
    #[inline(always)]
    pub(super) fn pairs(&self) -> &[Pair] {
        // SAFETY: `Lists` has written so many pairs, which the lifetime keeps as they are.
        unsafe { std::slice::from_raw_parts(self.first, self.count) }
    }

    /// How many taps.
    #[inline(always)]
    pub(crate) fn taps(&self) -> usize {
        self.taps
    }

    /// The pairs of each of the taps begin so many pairs after those of the one before.
    pub(super) const TAP_STRIDE: usize = BLOCK + SLACK;

    /// Panics when a pair names a row that is not there.
    #[inline(always)]
    pub(super) fn check(&self, inputs: usize, rows: usize) {
        assert!(
            self.inputs <= inputs && self.rows <= rows,
            "input row {} of {inputs}, row {} of {rows}",
            self.inputs.wrapping_sub(1),
            self.rows.wrapping_sub(1)
        );
    }
}
