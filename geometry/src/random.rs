//! The random numbers of the workspace, and its only hash. The numbers depend on a seed and a key alone: the same seed gives the same result.
//!
//! SplitMix64 (Steele, Lea, Flood 2014): small and fast; not for cryptography. (The simulator lays out scenes with ChaCha8.)

/// A stream of random numbers.
#[derive(Clone, Debug)]
pub struct Random {
    state: u64,
}

/// SplitMix64's output function: every bit of the argument reaches every bit of the result.
pub fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// The initial hash of [`fnv1a`].
pub const FNV_OFFSET: u64 = 0xcbf2_9ce4_8422_2325;

/// FNV-1a (64 bit): `hash` continued with more bytes.
pub fn fnv1a(hash: u64, bytes: &[u8]) -> u64 {
    bytes.iter().fold(hash, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3))
}

impl Random {
    /// The stream of `seed` and `key`; any two keys give unrelated streams.
    pub fn new(seed: u64, key: &[u64]) -> Random {
        let state = key.iter().fold(mix(seed ^ 0x6d6c_7563), |s, k| {
            mix(s.wrapping_add(0x9e37_79b9_7f4a_7c15) ^ mix(*k))
        });
        Random { state }
    }

    /// The plain SplitMix64 stream that begins at `state`.
    pub fn from_state(state: u64) -> Random {
        Random { state }
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        mix(self.state)
    }

    /// Uniform in `[0, 1)`.
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform in `[low, high)`.
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// True half of the time.
    pub fn coin(&mut self) -> bool {
        self.bits() >> 63 == 1
    }

    /// Uniform in `0..count`; 0 when `count` is 0.
    pub fn below(&mut self, count: usize) -> usize {
        ((self.unit() * count as f64) as usize).min(count.saturating_sub(1))
    }

    /// Standard normal (Box-Muller).
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.unit()).cos()
    }

    /// Shuffles the items in place (Fisher-Yates).
    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for i in (1..items.len()).rev() {
            items.swap(i, self.below(i + 1));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_those_of_the_named_distributions() {
        let mut random = Random::new(1, &[]);
        let n = 20_000;
        let uniform: f64 = (0..n).map(|_| random.unit()).sum::<f64>() / n as f64;
        let normal: Vec<f64> = (0..n).map(|_| random.normal()).collect();
        let [mean, deviation] = crate::mean_and_spread(&normal);
        assert!((uniform - 0.5).abs() < 0.01, "{uniform}");
        assert!(mean.abs() < 0.03, "{mean}");
        assert!((deviation - 1.0).abs() < 0.025, "{deviation}");
    }
}
