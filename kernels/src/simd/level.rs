//! Which registers this processor has.

use std::sync::atomic::{AtomicU8, Ordering};

use super::{Kernel, plain::Plain};

/// A set of vector registers that this processor has: a value exists only where that is so.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Level(Kind);

/// The fastest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
enum Kind {
    #[cfg(target_arch = "x86_64")]
    Avx512Bf16,
    #[cfg(target_arch = "x86_64")]
    Avx512Vnni,
    #[cfg(target_arch = "x86_64")]
    Avx512,
    #[cfg(target_arch = "x86_64")]
    AvxVnni,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "aarch64")]
    NeonDot,
    #[cfg(target_arch = "aarch64")]
    Neon,
    Plain,
}

/// Every kind of this architecture, the fastest first.
const KINDS: &[Kind] = &[
    #[cfg(target_arch = "x86_64")]
    Kind::Avx512Bf16,
    #[cfg(target_arch = "x86_64")]
    Kind::Avx512Vnni,
    #[cfg(target_arch = "x86_64")]
    Kind::Avx512,
    #[cfg(target_arch = "x86_64")]
    Kind::AvxVnni,
    #[cfg(target_arch = "x86_64")]
    Kind::Avx2,
    #[cfg(target_arch = "aarch64")]
    Kind::NeonDot,
    #[cfg(target_arch = "aarch64")]
    Kind::Neon,
    Kind::Plain,
];

/// [`Level::best`] answers no faster kind than the one of this number.
static FASTEST: AtomicU8 = AtomicU8::new(0);

impl Kind {
    /// Whether this processor has it. The standard library caches the answers of the processor.
    #[cfg(target_arch = "x86_64")]
    fn exists(self) -> bool {
        let avx2 = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma");
        let avx512 = avx2
            && is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("popcnt");
        let vnni = avx512 && is_x86_feature_detected!("avx512vnni");
        match self {
            Kind::Avx512Bf16 => vnni && is_x86_feature_detected!("avx512bf16"),
            Kind::Avx512Vnni => vnni,
            Kind::Avx512 => avx512,
            Kind::AvxVnni => avx2 && is_x86_feature_detected!("avxvnni"),
            Kind::Avx2 => avx2,
            Kind::Plain => true,
        }
    }

    /// Whether this processor has it.
    #[cfg(target_arch = "aarch64")]
    fn exists(self) -> bool {
        let neon = std::arch::is_aarch64_feature_detected!("neon");
        match self {
            Kind::NeonDot => neon && std::arch::is_aarch64_feature_detected!("dotprod"),
            Kind::Neon => neon,
            Kind::Plain => true,
        }
    }

    /// Whether this processor has it.
    #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
    fn exists(self) -> bool {
        true
    }
}

impl Level {
    /// The fastest set of this processor, or the one that [`Level::restrict`] named.
    pub fn best() -> Level {
        let first = FASTEST.load(Ordering::Relaxed);
        let mut kinds = KINDS.iter().filter(|kind| **kind as u8 >= first);
        let found = kinds.find(|kind| kind.exists());
        Level(found.copied().unwrap_or(Kind::Plain))
    }

    /// Every set of this processor, the fastest first; the last one is portable.
    pub fn all() -> Vec<Level> {
        let kinds = KINDS.iter().filter(|kind| kind.exists());
        kinds.map(|kind| Level(*kind)).collect()
    }

    /// From now on [`Level::best`] is this one in the whole program: for tests of what other processors would run, and
    /// to compare them.
    pub fn restrict(self) {
        FASTEST.store(self.0 as u8, Ordering::Relaxed);
    }

    /// `avx512bf16`, `avx512vnni`, `avx512`, `avxvnni`, `avx2`, `neondot`, `neon` or `portable`, for a report of what a
    /// machine runs.
    pub fn name(self) -> &'static str {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512Bf16 => "avx512bf16",
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512Vnni => "avx512vnni",
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 => "avx512",
            #[cfg(target_arch = "x86_64")]
            Kind::AvxVnni => "avxvnni",
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => "avx2",
            #[cfg(target_arch = "aarch64")]
            Kind::NeonDot => "neondot",
            #[cfg(target_arch = "aarch64")]
            Kind::Neon => "neon",
            Kind::Plain => "portable",
        }
    }

    /// Runs `kernel` compiled for this level.
    pub(crate) fn run<K: Kernel>(self, kernel: K) -> K::Output {
        match self.0 {
            // SAFETY (each): the value was made by `best` or `all`, which asked the processor for these features.
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512Bf16 => unsafe { super::avx512::run_bf16(kernel) },
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512Vnni => unsafe { super::avx512::run_vnni(kernel) },
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 => unsafe { super::avx512::run(kernel) },
            #[cfg(target_arch = "x86_64")]
            Kind::AvxVnni => unsafe { super::avx2::run_vnni(kernel) },
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => unsafe { super::avx2::run(kernel) },
            #[cfg(target_arch = "aarch64")]
            Kind::NeonDot => unsafe { super::neon::run_dot(kernel) },
            #[cfg(target_arch = "aarch64")]
            Kind::Neon => unsafe { super::neon::run(kernel) },
            Kind::Plain => portable(kernel),
        }
    }
}

/// Not inlined: the others' callers are not to hold its stack too.
#[inline(never)]
fn portable<K: Kernel>(kernel: K) -> K::Output {
    kernel.run(Plain)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_begins_with_the_best_and_ends_portable() {
        let all = Level::all();
        assert_eq!(all[0], Level::best());
        assert_eq!(all[all.len() - 1].name(), "portable");
        let names: std::collections::BTreeSet<_> = all.iter().map(|level| level.name()).collect();
        assert_eq!(names.len(), all.len(), "each once: {names:?}");
    }
}
