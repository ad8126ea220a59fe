//! Random numbers for the tests of this crate.

/// splitmix64.
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Random {
        Random(seed)
    }
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }
    pub(crate) fn below(&mut self, bound: usize) -> usize {
        (self.next() % bound as u64) as usize
    }
    /// In [low, high).
    pub(crate) fn uniform(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * (self.next() >> 40) as f32 / (1u64 << 24) as f32
    }
}

use crate::sites::Sites;

/// At most `count` sites anywhere on a grid.
pub(crate) fn random_sites(shape: [usize; 3], count: usize, seed: u64) -> Sites {
    let mut sites = Sites::new(shape);
    let mut random = Random::new(seed);
    for _ in 0..count {
        sites.insert(
            random.below(shape[0]),
            random.below(shape[1]),
            random.below(shape[2]),
        );
    }
    sites.finish();
    sites
}
