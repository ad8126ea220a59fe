//! How large the values between the bird's-eye layers get, for [`crate::Precision::Int8`].
//!
//! Each channel has a histogram of its values (they are not negative) over equal steps of the logarithm. Its first range
//! is the one for which rounding to 255 steps, and cutting what is larger, gives the least mean square error. A rare large
//! value weighs by the square of what would be cut from it, so ranges keep the few cells with objects in them. The
//! ranges of a level are then balanced against the weights that read it ([`crate::balance`]).

use mluc_model::{Folded, MAP_LEVEL, ModelError, Network, WeightSet, calibrated_levels};

use crate::balance::{Channel, balanced};
use crate::histogram::{BINS, bin};
use crate::trace::Level;

/// Collects the values of every level that a byte can hold, from frames computed in f32.
///
/// Give [`Calibrator::observe`] to [`crate::Backbone::run_observed`], over scans like those to come; then
/// [`Calibrator::write`].
#[derive(Clone, Debug)]
pub struct Calibrator {
    levels: Vec<Histograms>,
}

/// Of one level.
#[derive(Clone, Debug)]
struct Histograms {
    level: String,
    channels: usize,
    /// `[channel][bin]`.
    counts: Vec<u64>,
}

impl Calibrator {
    /// Nothing seen yet.
    pub fn new(network: &Network) -> Calibrator {
        let levels = calibrated_levels(network).into_iter();
        let histograms = |(level, channels)| Histograms {
            level,
            channels,
            counts: vec![0; channels * BINS],
        };
        Calibrator {
            levels: levels.map(histograms).collect(),
        }
    }

    /// Counts the values of a level; levels that stay as they are in int8 are passed over.
    pub fn observe(&mut self, level: Level) {
        let Some(seen) = self.levels.iter_mut().find(|seen| seen.level == level.name) else {
            return;
        };
        for row in level.values.chunks_exact(seen.channels) {
            for (channel, value) in row.iter().enumerate() {
                if let Some(bin) = bin(*value) {
                    seen.counts[channel * BINS + bin] += 1;
                }
            }
        }
    }

    /// Puts the ranges into `weights`, whose layers read these levels. A channel that was 0 in every frame gets the largest
    /// range of its level: whatever it holds one day will fit. False where nothing but 0 was seen at some level; nothing is
    /// written then.
    pub fn write(&self, network: &Network, weights: &mut WeightSet) -> Result<bool, ModelError> {
        let mut ranges = vec![];
        for seen in &self.levels {
            let readers = readers(network, weights, &seen.level)?;
            match balanced(seen.channels(), &readers) {
                Some(range) => ranges.push(range),
                None => return Ok(false),
            }
        }
        for (seen, range) in self.levels.iter().zip(ranges) {
            weights.set_range(&seen.level, range);
        }
        Ok(true)
    }
}

/// The layers that read a level.
fn readers(network: &Network, weights: &WeightSet, level: &str) -> Result<Vec<Folded>, ModelError> {
    let layers: Vec<_> = network.block1.iter().chain(&network.block2).collect();
    let place = layers.iter().position(|layer| layer.name == level);
    let next = match place {
        Some(place) => layers.get(place + 1),
        None if level == MAP_LEVEL => layers.first(),
        None => None,
    };
    let mut readers = vec![];
    if let Some(layer) = next {
        readers.push(Folded::dense(weights, layer)?);
    }
    for (block, up) in [
        (&network.block1, &network.up1),
        (&network.block2, &network.up2),
    ] {
        if block.last().is_some_and(|layer| layer.name == level) {
            readers.push(Folded::up(weights, up)?);
        }
    }
    Ok(readers)
}

impl Histograms {
    fn channels(&self) -> Vec<Channel<'_>> {
        let counts = self.counts.chunks_exact(BINS);
        counts.map(Channel::new).collect()
    }
}
