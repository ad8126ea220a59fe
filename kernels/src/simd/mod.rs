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
mod cover;
mod level;
#[cfg(target_arch = "aarch64")]
mod neon;
mod peak;
mod plain;
mod tiles;

pub(crate) use aligned::{Aligned, AlignedArray, LINE};
pub use level::Level;
pub use peak::spin;
pub(crate) use tiles::{Pair, convolve_tiles, gradient_tiles};

/// Vector registers of f32. A value of the implementing type is the proof that the processor has them.
pub(crate) trait Simd: Copy {
    /// One register.
    type Vector: Copy;
    /// f32 in a register.
    const LANES: usize;
    /// Registers that the processor names.
    const REGISTERS: usize;

    /// All lanes equal to `value`.
    fn splat(self, value: f32) -> Self::Vector;

    /// `a * b + c`.
    fn fma(self, a: Self::Vector, b: Self::Vector, c: Self::Vector) -> Self::Vector;

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
}

/// Work that [`Level::run`] compiles for each kind of register.
pub(crate) trait Kernel {
    /// What the work returns.
    type Output;

    /// Does the work. Implement it `#[inline(always)]`.
    fn run<S: Simd>(self, simd: S) -> Self::Output;
}
