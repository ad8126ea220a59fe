//! How far a figure can be trusted: the bootstrap over frames (Efron, 1979).
//!
//! Frames are drawn with replacement, as many as there are, and the figure is taken again; the standard deviation over
//! the draws estimates what another test set of the same size would have changed. The boxes of one frame stay together,
//! since they share what went wrong in it.

use crate::JudgedFrames;
use mluc_geometry::{Random, mix};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Every named figure of all frames, with its standard deviation over `resamples` draws. The same seed gives the same bits,
/// with any number of threads; with fewer than two draws or frames the deviation is 0.
pub fn bootstrap(frames: &JudgedFrames, resamples: usize, seed: u64) -> BTreeMap<String, [f64; 2]> {
    let figures = |draw| {
        let indices = resample(frames.len(), seed, draw as u64);
        frames.figures(&indices).named().map(|(_, value)| value)
    };
    let draws: Vec<_> = (0..resamples).into_par_iter().map(figures).collect();
    let named = frames.all().named();
    let with_spread = named.iter().enumerate().map(|(at, (name, value))| {
        let values: Vec<f64> = draws.iter().map(|draw| draw[at]).collect();
        ((*name).to_owned(), [*value, mean_and_spread(&values)[1]])
    });
    with_spread.collect()
}

/// Mean and standard deviation (n - 1) of some values; the deviation of fewer than two is 0.
pub fn mean_and_spread(values: &[f64]) -> [f64; 2] {
    let count = values.len() as f64;
    if values.is_empty() {
        return [0.0; 2];
    }
    let mean = values.iter().sum::<f64>() / count;
    let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    let spread = if values.len() > 1 {
        (squares / (count - 1.0)).sqrt()
    } else {
        0.0
    };
    [mean, spread]
}

/// As many indices as there are frames, each drawn from all of them.
fn resample(count: usize, seed: u64, draw: u64) -> Vec<usize> {
    let mut random = Random::from_state(mix(seed ^ mix(draw)));
    // The high part of the product maps 64 random bits onto 0..count.
    let mut next = || ((u128::from(random.bits()) * count as u128) >> 64) as usize;
    (0..count).map(|_| next()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_are_spread_evenly_and_depend_on_the_seed() {
        let indices = resample(1000, 1, 0);
        let mut seen: Vec<usize> = indices.clone();
        seen.sort_unstable();
        seen.dedup();
        // 1 - 1/e of them: 632 in the mean, 15 either way is three deviations and more.
        assert!((587..=677).contains(&seen.len()), "{}", seen.len());
        assert_eq!(indices, resample(1000, 1, 0));
        assert_ne!(indices, resample(1000, 1, 1));
        assert_ne!(indices, resample(1000, 2, 0));
        assert!(resample(0, 1, 0).is_empty());
    }

    #[test]
    fn mean_and_deviation() {
        assert_eq!(mean_and_spread(&[1.0, 3.0]), [2.0, 2.0f64.sqrt()]);
        assert_eq!(mean_and_spread(&[5.0]), [5.0, 0.0]);
        assert_eq!(mean_and_spread(&[]), [0.0, 0.0]);
    }
}
