//! Which registers this processor has.

use super::{Kernel, plain::Plain};

/// A set of vector registers that this processor has: a value exists only where that is so.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Level(Kind);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    #[cfg(target_arch = "x86_64")]
    Avx512,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "aarch64")]
    Neon,
    Plain,
}

impl Level {
    /// The fastest set of this processor.
    pub fn best() -> Level {
        // The standard library caches the answers of the processor.
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            let avx512 = is_x86_feature_detected!("avx512f");
            return Level(if avx512 { Kind::Avx512 } else { Kind::Avx2 });
        }
        #[cfg(target_arch = "aarch64")]
        if std::arch::is_aarch64_feature_detected!("neon") {
            return Level(Kind::Neon);
        }
        Level(Kind::Plain)
    }

    /// Every set of this processor, the fastest first; the last one is portable.
    pub fn all() -> Vec<Level> {
        let best = Level::best();
        let mut all = vec![best];
        #[cfg(target_arch = "x86_64")]
        if best.0 == Kind::Avx512 {
            all.push(Level(Kind::Avx2));
        }
        if best.0 != Kind::Plain {
            all.push(Level(Kind::Plain));
        }
        all
    }

    /// `avx512`, `avx2`, `neon` or `portable`, for a report of what a machine runs.
    pub fn name(self) -> &'static str {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512 => "avx512",
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => "avx2",
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
            Kind::Avx512 => unsafe { super::avx512::run(kernel) },
            #[cfg(target_arch = "x86_64")]
            Kind::Avx2 => unsafe { super::avx2::run(kernel) },
            #[cfg(target_arch = "aarch64")]
            Kind::Neon => unsafe { super::neon::run(kernel) },
            Kind::Plain => kernel.run(Plain),
        }
    }
}
