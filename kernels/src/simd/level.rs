//! The vector registers that this processor has.

use std::sync::atomic::{AtomicU8, Ordering};

#[cfg(target_arch = "aarch64")]
use super::neon;
use super::{Kernel, Simd, plain};
#[cfg(target_arch = "x86_64")]
use super::{avx2, avx512};

/// A set of vector registers. A value exists only on a processor that has them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Level(Kind);

/// The kinds of all architectures, the fastest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
enum Kind {
    Avx512Bf16,
    Avx512Vnni,
    Avx512,
    AvxVnni,
    Avx2,
    NeonDot,
    Neon,
    Plain,
}

use Kind::*;

/// Every kind and its name, the fastest first.
const KINDS: [(Kind, &str); 8] = [
    (Avx512Bf16, "avx512bf16"),
    (Avx512Vnni, "avx512vnni"),
    (Avx512, "avx512"),
    (AvxVnni, "avxvnni"),
    (Avx2, "avx2"),
    (NeonDot, "neondot"),
    (Neon, "neon"),
    (Plain, "portable"),
];

/// Number of the fastest kind that [`Level::best`] may return.
static FASTEST: AtomicU8 = AtomicU8::new(0);

impl Kind {
    /// Whether this processor has this kind. The standard library caches the detection.
    #[cfg(target_arch = "x86_64")]
    fn exists(self) -> bool {
        let avx2 = is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("fma")
            && is_x86_feature_detected!("popcnt");
        let avx512 =
            avx2 && is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512bw");
        let vnni = avx512 && is_x86_feature_detected!("avx512vnni");
        match self {
            Avx512Bf16 => vnni && is_x86_feature_detected!("avx512bf16"),
            Avx512Vnni => vnni,
            Avx512 => avx512,
            AvxVnni => avx2 && is_x86_feature_detected!("avxvnni"),
            Avx2 => avx2,
            NeonDot | Neon => false,
            Plain => true,
        }
    }

    /// Whether this processor has this kind.
    #[cfg(not(target_arch = "x86_64"))]
    fn exists(self) -> bool {
        match self {
            #[cfg(target_arch = "aarch64")]
            NeonDot => Neon.exists() && std::arch::is_aarch64_feature_detected!("dotprod"),
            #[cfg(target_arch = "aarch64")]
            Neon => std::arch::is_aarch64_feature_detected!("neon"),
            _ => self == Plain,
        }
    }
}

impl Level {
    /// The fastest set of this processor, or the set that [`Level::restrict`] selected.
    pub fn best() -> Level {
        let first = FASTEST.load(Ordering::Relaxed);
        let mut kinds = KINDS.iter().map(|(kind, _)| *kind);
        let found = kinds.find(|kind| *kind as u8 >= first && kind.exists());
        Level(found.unwrap_or(Plain))
    }

    /// Every set of this processor, the fastest first; the last one is portable.
    pub fn all() -> Vec<Level> {
        KINDS.iter().filter(|(kind, _)| kind.exists()).map(|(kind, _)| Level(*kind)).collect()
    }

    /// Makes [`Level::best`] return this level in the whole program, to test and compare what other processors would run.
    pub fn restrict(self) {
        FASTEST.store(self.0 as u8, Ordering::Relaxed);
    }

    /// The name, for reports: `avx512bf16`, `avx512vnni`, `avx512`, `avxvnni`, `avx2`, `neondot`, `neon` or `portable`.
    pub fn name(self) -> &'static str {
        KINDS[self.0 as usize].1
    }

    /// Whether rows of bytes are multiplied faster as i16: on `avx512`, `avx2` and `portable`, which have no products of bytes.
    pub fn widens_bytes(self) -> bool {
        matches!(self.0, Avx512 | Avx2 | Plain)
    }

    /// Runs `kernel` compiled for this level.
    pub(crate) fn run<K: Kernel>(self, kernel: K) -> K::Output {
        // SAFETY (each): `best` or `all` has constructed the value and checked that the processor has these features.
        #[cfg(target_arch = "x86_64")]
        match self.0 {
            Avx512Bf16 => return unsafe { avx512::run_bf16(kernel) },
            Avx512Vnni => return unsafe { avx512::run_vnni(kernel) },
            Avx512 => return unsafe { avx512::run(kernel) },
            AvxVnni => return unsafe { avx2::run_vnni(kernel) },
            Avx2 => return unsafe { avx2::run(kernel) },
            NeonDot | Neon | Plain => (),
        }
        #[cfg(target_arch = "aarch64")]
        match self.0 {
            NeonDot => return unsafe { neon::run_dot(kernel) },
            Neon => return unsafe { neon::run(kernel) },
            _ => (),
        }
        portable(kernel)
    }
}

/// Runs `work` (plain code) compiled for the best registers of this processor, as far as the compiler inlines it. The compiled
/// code may use population counts and shifts that the oldest processors lack.
#[inline]
pub fn at_best<R>(work: impl FnOnce() -> R) -> R {
    Level::best().run(Work(work))
}

/// [`at_best`](fn@at_best) of an expression that is inlined into it.
#[macro_export]
macro_rules! at_best {
    ($work:expr) => {
        $crate::at_best(
            #[inline(always)]
            || $work,
        )
    };
}

struct Work<F>(F);

impl<F: FnOnce() -> R, R> Kernel for Work<F> {
    type Output = R;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> R {
        (self.0)()
    }
}

/// Not inlined, so that a caller that runs another level does not reserve its stack.
#[inline(never)]
fn portable<K: Kernel>(kernel: K) -> K::Output {
    kernel.run(plain::Plain)
}
