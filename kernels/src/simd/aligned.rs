//! Values that begin at a 64-byte boundary, so that no register load crosses a cache line.

use std::mem::MaybeUninit;

/// Number of values in a cache line; channels are padded to a multiple of it.
pub(crate) const LINE: usize = 16;

#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
struct Line<T>([T; LINE]);

/// Owned values of four bytes each; the length is rounded up to a multiple of [`LINE`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Aligned<T>(Vec<Line<T>>);

impl<T: Copy + Default> Aligned<T> {
    /// Whole lines of T have no padding.
    const DENSE: () = assert!(size_of::<Line<T>>() == LINE * size_of::<T>());

    pub(crate) fn zeros(len: usize) -> Aligned<T> {
        Aligned(vec![Line([T::default(); LINE]); len.div_ceil(LINE)])
    }

    pub(crate) fn as_slice(&self) -> &[T] {
        let () = Self::DENSE;
        // SAFETY: a Line is exactly LINE consecutive T (repr(C), no padding), all of them initialised; the borrow of self covers the result.
        unsafe { std::slice::from_raw_parts(self.0.as_ptr().cast(), self.0.len() * LINE) }
    }

    pub(crate) fn as_mut_slice(&mut self) -> &mut [T] {
        let () = Self::DENSE;
        // SAFETY: as in `as_slice`; the mutable borrow of self makes the result the only reference.
        unsafe { std::slice::from_raw_parts_mut(self.0.as_mut_ptr().cast(), self.0.len() * LINE) }
    }
}

/// Values on the stack at a 64-byte boundary.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct AlignedArray<T, const N: usize>(pub(crate) [T; N]);

/// Room for rows on the stack, at a 64-byte boundary. Nothing is written before [`Room::rows`].
pub(crate) struct Room<T, const N: usize>(AlignedArray<MaybeUninit<T>, N>);

impl<T: Copy, const N: usize> Room<T, N> {
    /// Room without any written value.
    #[inline(always)]
    pub(crate) fn new() -> Room<T, N> {
        Room(AlignedArray([const { MaybeUninit::uninit() }; N]))
    }

    /// `count` rows, all equal to `row`; the length of `row` is a multiple of [`LINE`].
    #[inline(always)]
    pub(crate) fn rows(&mut self, count: usize, row: &[T]) -> &mut [T] {
        assert!(row.len().is_multiple_of(LINE), "rows of {}", row.len());
        let values = &mut self.0.0[..count * row.len()];
        for to in values.chunks_exact_mut(row.len()) {
            // One cache line at a time: the compiler knows its length.
            for (to, from) in to.chunks_exact_mut(LINE).zip(row.chunks_exact(LINE)) {
                for (to, from) in to.iter_mut().zip(from) {
                    to.write(*from);
                }
            }
        }
        // SAFETY: every value has just been written; MaybeUninit<T> has the layout of T.
        unsafe { &mut *(values as *mut [MaybeUninit<T>] as *mut [T]) }
    }
}
