//! Values that begin at a 64-byte boundary, so that no register load crosses a cache line.

/// Values in a cache line, and the granularity to which channels are padded.
pub(crate) const LINE: usize = 16;

#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
struct Line<T>([T; LINE]);

/// Owned values of four bytes each; the length is rounded up to a multiple of [`LINE`].
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Aligned<T>(Vec<Line<T>>);

impl<T: Copy + Default> Aligned<T> {
    /// Whole lines of T have no padding.
    const DENSE: () = assert!(size_of::<Line<T>>() == LINE * size_of::<T>());

    pub(crate) fn zeros(len: usize) -> Aligned<T> {
        Aligned(vec![Line([T::default(); LINE]); len.div_ceil(LINE)])
    }

    pub(crate) fn as_slice(&self) -> &[T] {
        let () = Self::DENSE;
        // SAFETY: a Line is exactly LINE consecutive T (repr(C), no padding), all of them initialised; the borrow of
        // self covers the result.
        unsafe { std::slice::from_raw_parts(self.0.as_ptr().cast(), self.0.len() * LINE) }
    }

    pub(crate) fn as_mut_slice(&mut self) -> &mut [T] {
        let () = Self::DENSE;
        // SAFETY: as in `as_slice`; the mutable borrow of self makes it the only one.
        unsafe { std::slice::from_raw_parts_mut(self.0.as_mut_ptr().cast(), self.0.len() * LINE) }
    }
}

/// Values on the stack at a 64-byte boundary.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct AlignedArray<T, const N: usize>(pub(crate) [T; N]);
