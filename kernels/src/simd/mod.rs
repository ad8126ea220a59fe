//! One small trait for the vector registers of every processor; the level is chosen at run time.
//!
//! A [`Kernel`] is written once, generic over [`Simd`], and compiled for every [`Level`]. Its code must be
//! `#[inline(always)]` down to the registers: only code that is inlined into a level's entry is compiled for its features.
//! All `unsafe` of this crate is in this folder.
#![allow(unsafe_code)]

/// Methods of a [`Simd`] that are one expression of instructions; `self` alone proves that the processor has them.
macro_rules! methods {
    ($(fn $name:ident($($argument:ident: $type:ty),*) -> $out:ty = $value:expr;)*) => {$(
        #[inline(always)]
        #[allow(unused_unsafe)] // `plain` needs none.
        fn $name(self, $($argument: $type),*) -> $out {
            unsafe { $value }
        }
    )*};
}

/// The functions that construct a register type, and run a kernel compiled for features of the processor.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
macro_rules! entries {
    ($($(#[$about:meta])* $name:ident($features:literal) = $simd:expr;)*) => {$(
        $(#[$about])*
        ///
        /// # Safety
        /// The processor has these features.
        #[target_feature(enable = $features)]
        pub(crate) unsafe fn $name<K: $crate::simd::Kernel>(kernel: K) -> K::Output {
            kernel.run($simd)
        }
    )*};
}

/// A function of a type that runs a kernel. It is compiled once, in this crate; generic code is compiled in each crate that calls it.
macro_rules! compiled_here {
    ($name:ident($work:ident) $(-> $out:ty)?) => {
        #[inline(never)]
        fn $name(level: $crate::Level, work: $work<Self>) $(-> $out)? {
            level.run(work)
        }
    };
}
pub(crate) use compiled_here;

mod aligned;
#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod cover;
mod element;
mod level;
mod list;
#[cfg(target_arch = "aarch64")]
mod neon;
mod operand;
mod peak;
mod plain;
mod rows;
mod tiles;
mod winograd;

pub(crate) use aligned::{Aligned, AlignedArray, LINE, Room};
pub use element::{Bf16, Element};
pub use level::{Level, at_best};
pub(crate) use list::{BLOCK, Lists};
pub(crate) use operand::{Operand, Sum};
pub use peak::spin;
pub(crate) use rows::Rows;
pub(crate) use tiles::{Products, gradient_tiles};
pub use winograd::Tiled;
pub(crate) use winograd::{Output, PLACES, TILES_MAX, WINDOWS, Windows};

/// Vector registers. A value of the implementing type is the proof that the processor has them.
///
/// # Safety
/// Both registers are `LANES` values of 32 bits, of which every pattern is valid.
pub unsafe trait Simd: Copy {
    /// A register of f32, `LANES` of them.
    type Vector: Copy;
    /// A register of `LANES` 32-bit lanes: i32, pairs of bf16 or i16 (the first in the lower half), or quads of bytes.
    type Bits: Copy;
    /// Number of f32 in a register.
    const LANES: usize;
    /// Number of registers.
    const REGISTERS: usize;
    /// Whether the processor only multiplies signed bytes; then 128 is subtracted from each input.
    const SIGNED_BYTES: bool = false;

    /// All lanes equal to `value`.
    fn splat(self, value: f32) -> Self::Vector;

    /// `a * b + c`.
    fn fma(self, a: Self::Vector, b: Self::Vector, c: Self::Vector) -> Self::Vector;

    /// [`Simd::splat`] of a lane of bits.
    fn splat_bits(self, lane: u32) -> Self::Bits;

    /// The two bf16 of each lane as f32.
    fn halves(self, pairs: Self::Bits) -> (Self::Vector, Self::Vector);

    /// For pairs of bf16: `a.0 * b.0 + a.1 * b.1 + c` in each lane. The number of roundings depends on the processor.
    #[inline(always)]
    fn dot_pairs(self, a: Self::Bits, b: Self::Bits, c: Self::Vector) -> Self::Vector {
        let (a, b) = (self.halves(a), self.halves(b));
        self.fma(a.1, b.1, self.fma(a.0, b.0, c))
    }

    /// For quads of bytes: `a.0 * b.0 + a.1 * b.1 + a.2 * b.2 + a.3 * b.3 + c` in each lane, exactly, modulo 2^32. `a` has
    /// u8, or i8 with [`Simd::SIGNED_BYTES`]; `b` has i8, `c` has i32.
    fn dot_quads(self, a: Self::Bits, b: Self::Bits, c: Self::Bits) -> Self::Bits;

    /// For pairs of i16: `a.0 * b.0 + a.1 * b.1 + c` in each lane, modulo 2^32.
    fn dot_shorts(self, a: Self::Bits, b: Self::Bits, c: Self::Bits) -> Self::Bits;

    /// `a + b` of i32, modulo 2^32.
    fn add_bits(self, a: Self::Bits, b: Self::Bits) -> Self::Bits;

    /// `a - b` of i32, modulo 2^32.
    fn sub_bits(self, a: Self::Bits, b: Self::Bits) -> Self::Bits;

    /// `a + b` of i16, modulo 2^16.
    fn add_shorts(self, a: Self::Bits, b: Self::Bits) -> Self::Bits;

    /// `a - b` of i16, modulo 2^16.
    fn sub_shorts(self, a: Self::Bits, b: Self::Bits) -> Self::Bits;

    /// Lists the block's rows that are present at each tap from `first` on, for as many taps as `lists` has room for.
    #[inline(always)]
    fn list(self, lists: &mut Lists, first: usize) {
        lists.list_plain(first);
    }
}

/// Reads a register `V` of a [`Simd`].
///
/// # Safety
/// `from` is valid for reads of as many values as `V` has lanes; no alignment is needed.
#[inline(always)]
unsafe fn load<V: Copy, T>(from: *const T) -> V {
    // SAFETY: the caller guarantees the values; every bit pattern of them is a valid register.
    unsafe { from.cast::<V>().read_unaligned() }
}

/// Writes a register `V` of a [`Simd`].
///
/// # Safety
/// `to` is valid for writes of as many values as `V` has lanes; no alignment is needed.
#[inline(always)]
unsafe fn store<V: Copy, T>(to: *mut T, value: V) {
    // SAFETY: the caller guarantees the values.
    unsafe { to.cast::<V>().write_unaligned(value) }
}

/// Work that [`Level::run`] compiles for each kind of register.
pub(crate) trait Kernel {
    /// What the work returns.
    type Output;

    /// Does the work. Implement it `#[inline(always)]`.
    fn run<S: Simd>(self, simd: S) -> Self::Output;
}

/// The larger of `value` and `floor`; NaN stays NaN.
#[inline(always)]
pub(crate) fn clamp(value: f32, floor: f32) -> f32 {
    if value < floor { floor } else { value }
}
