//! For each tap, the rows of a block that have an input row.

use super::Simd;
use crate::ABSENT;
use std::{marker::PhantomData, mem::MaybeUninit};

/// An input row and the row of the block that reads it at a tap.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub(super) struct Pair {
    /// Row of the input.
    pub(super) input: u32,
    /// Row of the block: of its sums (forward) or of its output gradients.
    pub(super) row: u32,
}

/// Number of rows in a block. The block's sums (at most 64 channels) fill three quarters of a first-level cache of 32 KiB.
/// A multiple of all tile heights (6, 8, 12), so that tall tiles cover a block without absent rows.
pub(crate) const BLOCK: usize = 96;
/// Number of taps that are listed at once: the lanes of an AVX-512 register.
pub(super) const GROUP: usize = 16;
/// Extra room at the end, in pairs: a register of pairs is always written whole, and only the present pairs are counted.
const SLACK: usize = 8;

/// The pairs of one block of rows, for [`GROUP`] taps at a time.
///
/// Safe code relies on what [`Simd::list`] writes: `counts`, `inputs`, and pairs whose rows are rows of the block.
pub struct Lists<'a> {
    /// The input row of each row of the block and each tap.
    pub(super) index: &'a [u32],
    pub(super) taps: usize,
    /// Number of rows of the block; at most [`BLOCK`].
    pub(super) rows: usize,
    pub(super) pairs: [[MaybeUninit<Pair>; BLOCK + SLACK]; GROUP],
    /// Number of pairs at each tap of the group; these pairs are initialised.
    pub(super) counts: [usize; GROUP],
    /// Every listed input row is below this.
    pub(super) inputs: usize,
    /// First tap of the group that is listed.
    held: Option<usize>,
}

/// The pairs of one tap, or of several consecutive taps at which every row of the block is present; and bounds of their rows.
#[derive(Clone, Copy)]
pub(crate) struct Listed<'a> {
    /// The first pair of the first tap. At each of the `taps` taps, [`Listed::TAP_STRIDE`] pairs apart, `count` pairs can be read.
    pub(super) first: *const Pair,
    /// Number of pairs at each tap.
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

    /// [`Lists::at_tap`], with the listed taps after it as long as every row is present at each of them: the sums can stay in registers.
    #[inline(always)]
    pub(crate) fn at_taps_from<S: Simd>(&mut self, simd: S, tap: usize) -> Listed<'_> {
        self.at_tap(simd, tap);
        let (rows, place) = (self.rows, tap % GROUP);
        let last = GROUP.min(self.taps - (tap - place));
        let full = self.counts[place..last].iter().take_while(|count| **count == rows);
        Listed { taps: full.count().max(1), ..self.at_tap(simd, tap) }
    }

    /// The implementation of [`Simd::list`] for any processor.
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
                // SAFETY: `new` has checked that `index` has `rows` (at most BLOCK) rows of `taps` entries; `count` is not above `row`.
                let (input, pair) = unsafe {
                    let input = *self.index.get_unchecked(row * self.taps + tap);
                    (input, pairs.get_unchecked_mut(count))
                };
                // The pair is always written, and counted only when present: no branch can be mispredicted.
                let row = row as u32;
                pair.write(Pair { input, row });
                count += usize::from(input != ABSENT);
            }
            *counted = count;
        }
    }
}

impl Listed<'_> {
    /// The pairs of the first tap.
    #[inline(always)]
    pub(super) fn pairs(&self) -> &[Pair] {
        // SAFETY: `Lists` has written `count` pairs; the lifetime keeps them unchanged.
        unsafe { std::slice::from_raw_parts(self.first, self.count) }
    }

    /// Number of taps.
    #[inline(always)]
    pub(crate) fn taps(&self) -> usize {
        self.taps
    }

    /// Distance, in pairs, from the first pair of a tap to the first pair of the next tap.
    pub(super) const TAP_STRIDE: usize = BLOCK + SLACK;

    /// Panics when a pair names a row that does not exist.
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
