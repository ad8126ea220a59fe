//! How far a figure can be trusted: the bootstrap over frames (Efron, 1979).
//!
//! Frames are drawn with replacement, as many as there are, and the figure is taken again; the standard deviation over
//! the draws estimates what another test set of the same size would have changed. The boxes of one frame stay together,
//! since they share what went wrong in it.

use crate::JudgedFrames;
use mluc_geometry::{Random, mean_and_spread, mix, resample};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Every named figure of all frames, with its standard deviation over `resamples` draws. The same seed gives the same bits,
/// with any number of threads; with fewer than two draws or frames the deviation is 0.
pub fn bootstrap(frames: &JudgedFrames, resamples: usize, seed: u64) -> BTreeMap<String, [f64; 2]> {
    let figures = |draw| {
        let mut random = Random::from_state(mix(seed ^ mix(draw as u64)));
        let indices = resample(frames.len(), 1, &mut random);
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
