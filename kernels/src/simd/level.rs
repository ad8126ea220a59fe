//! Which registers this processor has.

use super::{Kernel, plain::Plain};

/// A set of vector registers that this processor has: a value exists only where that is so.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Level(Kind);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    #[cfg(target_arch = "x86_64")]
    Avx512Bf16,
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
            let avx512 = is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("popcnt");
            return Level(match avx512 {
                true if is_x86_feature_detected!("avx512bf16") => Kind::Avx512Bf16,
                true => Kind::Avx512,
                false => Kind::Avx2,
            });
        }
        #[cfg(target_arch = "aarch64")]
        if std::arch::is_aarch64_feature_detected!("neon") {
            return Level(Kind::Neon);
        }
        Level(Kind::Plain)
    }

    /// Every set of this processor, the fastest first; the last one is portable.
    pub fn all() -> Vec<Level> {
        let best = Level::best().0;
        let mut all = vec![best];
        #[cfg(target_arch = "x86_64")]
        {
            if best == Kind::Avx512Bf16 {
                all.push(Kind::Avx512);
            }
            if best == Kind::Avx512Bf16 || best == Kind::Avx512 {
                all.push(Kind::Avx2);
            }
        }
        if best != Kind::Plain {
            all.push(Kind::Plain);
        }
        all.into_iter().map(Level).collect()
    }

    /// `avx512bf16`, `avx512`, `avx2`, `neon` or `portable`, for a report of what a machine runs.
    pub fn name(self) -> &'static str {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Kind::Avx512Bf16 => "avx512bf16",
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
            Kind::Avx512Bf16 => unsafe { super::avx512_bf16::run(kernel) },
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
