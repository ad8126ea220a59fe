//! Randomness that depends only on its key.
//!
//! There are two forms. `hash` turns a key (seed, frame, stream, beam, column) into a number, so that each ray has its own values on any thread.
//! `Dice` is a ChaCha8 stream for the layout of one scene, keyed by (seed, split, frame): splits never share a stream.

use parry3d::math::Vector as V3;
use rand_chacha::{ChaCha8Rng, rand_core::Rng, rand_core::SeedableRng};

/// The first number of SplitMix64 from this state: every input bit affects every output bit.
pub(crate) fn splitmix64(state: u64) -> u64 {
    mluc_geometry::Random::from_state(state).bits()
}

/// Hash of a key of several parts, in order.
pub(crate) fn hash(parts: &[u64]) -> u64 {
    let mix = |state, part: &u64| splitmix64(state ^ part);
    parts.iter().fold(0x6D6C_7563, mix)
}

/// Uniform in [0, 1) from the upper 24 bits.
pub(crate) fn unit(bits: u64) -> f32 {
    (bits >> 40) as f32 / (1u64 << 24) as f32
}

/// Close to a standard normal: four uniform 16-bit numbers added and scaled (bounded by 3.5 deviations). No library
/// function is called, so the bits agree on every platform.
pub(crate) fn normal(bits: u64) -> f32 {
    let sum: u64 = (0..4).map(|i| (bits >> (16 * i)) & 0xFFFF).sum();
    (sum as f32 / 65536.0 - 2.0) * 1.732_050_8
}

/// The stream that lays out one scene.
pub(crate) struct Dice(ChaCha8Rng);

impl Dice {
    /// A separate stream for this key.
    pub(crate) fn new(key: &[u64]) -> Dice {
        Dice(ChaCha8Rng::seed_from_u64(hash(key)))
    }

    /// Uniform in [0, 1).
    pub(crate) fn unit(&mut self) -> f32 {
        unit(self.0.next_u64())
    }

    /// Uniform in [low, high).
    pub(crate) fn range(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    /// Uniform in [-half, half).
    pub(crate) fn spread(&mut self, half: f32) -> f32 {
        self.range(-half, half)
    }

    /// Three numbers, uniform in these ranges.
    pub(crate) fn size(&mut self, x: [f32; 2], y: [f32; 2], z: [f32; 2]) -> V3 {
        V3::from([x, y, z].map(|[low, high]| self.range(low, high)))
    }

    /// True with this probability.
    pub(crate) fn chance(&mut self, probability: f32) -> bool {
        self.unit() < probability
    }

    /// +1 or -1.
    pub(crate) fn sign(&mut self) -> f32 {
        if self.chance(0.5) { 1.0 } else { -1.0 }
    }

    /// Normal, cut at 2.5 deviations.
    pub(crate) fn normal(&mut self, mean: f32, deviation: f32) -> f32 {
        mean + deviation * normal(self.0.next_u64()).clamp(-2.5, 2.5)
    }

    /// Uniform whole number in low..=high.
    pub(crate) fn whole(&mut self, low: usize, high: usize) -> usize {
        low + (self.unit() * (high - low + 1) as f32) as usize
    }

    /// Index drawn with these weights (not all zero).
    pub(crate) fn weighted(&mut self, weights: &[f32]) -> usize {
        let mut rest = self.unit() * weights.iter().sum::<f32>();
        for (index, weight) in weights.iter().enumerate() {
            rest -= weight;
            if rest < 0.0 {
                return index;
            }
        }
        weights.len() - 1
    }

    /// Number of events when `mean` are expected (small means; at most 60).
    pub(crate) fn events(&mut self, mean: f32) -> usize {
        let mut product = self.unit();
        let limit = (-mean).exp();
        let mut count = 0;
        while product > limit && count < 60 {
            product *= self.unit();
            count += 1;
        }
        count
    }

    /// Inverse of a piecewise linear distribution given by its (probability, value) knots, from 0 to 1.
    pub(crate) fn quantile(&mut self, knots: &[(f32, f32)]) -> f32 {
        let p = self.unit();
        for pair in knots.windows(2) {
            let ((p0, v0), (p1, v1)) = (pair[0], pair[1]);
            if p <= p1 {
                return v0 + (v1 - v0) * (p - p0) / (p1 - p0);
            }
        }
        knots.last().map_or(0.0, |knot| knot.1)
    }
}
