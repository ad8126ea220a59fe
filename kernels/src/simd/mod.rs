//! The registers of a processor behind one small trait, chosen at run time.
//!
//! A [`Kernel`] is written once, generic over [`Simd`], and compiled for every [`Level`]. Its code must be
//! `#[inline(always)]` down to the registers: only what is inlined into a level's entry is compiled for its features.
//! All `unsafe` of this crate is in this folder.
#![allow(unsafe_code)]

mod aligned;
#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod convolve_bf16;
mod convolve_f32;
mod convolve_int8;
mod cover;
mod gradient_f32;
mod level;
mod list;
#[cfg(target_arch = "aarch64")]
mod neon;
mod pair;
mod peak;
mod plain;
mod plain_work;
mod winograd;

pub(crate) use aligned::{Aligned, AlignedArray, LINE, Room};
pub(crate) use convolve_bf16::convolve_tiles_bf16;
pub(crate) use convolve_f32::convolve_tiles;
pub(crate) use convolve_int8::convolve_tiles_int8;
pub(crate) use gradient_f32::gradient_tiles;
pub use level::Level;
pub(crate) use list::{BLOCK, Listed, Lists};
use pair::Pair;
pub use peak::{spin, spin_bf16, spin_int8};
pub use plain_work::at_best;
pub(crate) use winograd::{Output, Windows, WinogradMemory};

/// Vector registers of f32. A value of the implementing type is the proof that the processor has them.
pub(crate) trait Simd: Copy {
    /// One register.
    type Vector: Copy;
    /// A register of pairs of bf16, `LANES` of them.
    type Pairs: Copy;
    /// A register of i32, `LANES` of them.
    type Integers: Copy;
    /// A register of quads of bytes, `LANES` of them.
    type Quads: Copy;
    /// f32 in a register.
    const LANES: usize;
    /// Registers that the processor names.
    const REGISTERS: usize;
    /// Whether [`Simd::splat_quad`] takes 128 from each byte, because the processor multiplies signed bytes alone.
    const SIGNED_QUADS: bool;

    /// All lanes equal to `value`.
    fn splat(self, value: f32) -> Self::Vector;

    /// `a * b + c`.
    fn fma(self, a: Self::Vector, b: Self::Vector, c: Self::Vector) -> Self::Vector;

    /// All lanes equal to `pair`: two bf16, the first in the lower half.
    fn splat_pair(self, pair: u32) -> Self::Pairs;

    /// `a.0 * b.0 + a.1 * b.1 + c` in each lane. How often it rounds is the processor's choice.
    fn dot(self, a: Self::Pairs, b: Self::Pairs, c: Self::Vector) -> Self::Vector;

    /// Reads `LANES` pairs.
    ///
    /// # Safety
    /// `from` is valid for reads of `LANES` u32; no alignment is needed.
    unsafe fn load_pairs(self, from: *const u32) -> Self::Pairs;

    /// Reads `LANES` values.
    ///
    /// # Safety
    /// `from` is valid for reads of `LANES` f32; no alignment is needed.
    unsafe fn load(self, from: *const f32) -> Self::Vector;

    /// Writes `LANES` values.
    ///
    /// # Safety
    /// `to` is valid for writes of `LANES` f32; no alignment is needed.
    unsafe fn store(self, to: *mut f32, value: Self::Vector);

    /// All lanes equal to `quad`: four u8 as they lie in memory, or four i8 (see [`Simd::SIGNED_QUADS`]).
    fn splat_quad(self, quad: u32) -> Self::Quads;

    /// `a.0 * b.0 + a.1 * b.1 + a.2 * b.2 + a.3 * b.3 + c` in each lane, exactly; modulo 2^32. `a` is of
    /// [`Simd::splat_quad`], `b` holds i8.
    fn dot_quads(self, a: Self::Quads, b: Self::Quads, c: Self::Integers) -> Self::Integers;

    /// `a + b`, modulo 2^32.
    fn add_integers(self, a: Self::Integers, b: Self::Integers) -> Self::Integers;

    /// Reads `LANES` quads of i8.
    ///
    /// # Safety
    /// `from` is valid for reads of `LANES` u32; no alignment is needed.
    unsafe fn load_quads(self, from: *const u32) -> Self::Quads;

    /// Reads `LANES` values.
    ///
    /// # Safety
    /// `from` is valid for reads of `LANES` i32; no alignment is needed.
    unsafe fn load_integers(self, from: *const i32) -> Self::Integers;

    /// Writes `LANES` values.
    ///
    /// # Safety
    /// `to` is valid for writes of `LANES` i32; no alignment is needed.
    unsafe fn store_integers(self, to: *mut i32, value: Self::Integers);

    /// Lists the rows of `index` (rows of `taps`) that are present at each of the taps from `first` on, as many as
    /// `lists` holds.
    #[inline(always)]
    fn list(self, index: &[u32], taps: usize, first: usize, lists: &mut Lists) {
        lists.list_plain(index, taps, first);
    }
}

/// Work that [`Level::run`] compiles for each kind of register.
pub(crate) trait Kernel {
    /// What the work returns.
    type Output;

    /// Does the work. Implement it `#[inline(always)]`.
    fn run<S: Simd>(self, simd: S) -> Self::Output;
}
