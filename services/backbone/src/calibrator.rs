//! How large the values between the layers get, for [`crate::Precision::Int8`].
//!
//! Each channel has a histogram of its values (they are not negative) over equal steps of the logarithm. Its range holds
//! every value seen and some more; how much more is balanced against the weights that read it ([`crate::balance`]).

use mluc_model::{Folded, ModelError, Network, WeightSet, calibrated_layers};

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
        let layers = calibrated_layers(network).into_iter();
        let histograms = |(level, channels)| Histograms {
            level,
            channels,
            counts: vec![0; channels * BINS],
        };
        Calibrator {
            levels: layers.map(histograms).collect(),
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
        for (number, seen) in self.levels.iter().enumerate() {
            let readers = readers(network, weights, number)?;
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

/// The layers that read the output of the `number`-th of all sparse layers and those of both blocks.
fn readers(
    network: &Network,
    weights: &WeightSet,
    number: usize,
) -> Result<Vec<Folded>, ModelError> {
    let dense: Vec<_> = network.block1.iter().chain(&network.block2).collect();
    let Some(place) = number.checked_sub(network.sparse.len()) else {
        return Ok(vec![match network.sparse.get(number + 1) {
            Some(layer) => Folded::sparse(weights, layer)?,
            None => unfolded(
                Folded::dense(weights, dense[0])?,
                network.sparse[number].cout,
            ),
        }]);
    };
    let mut readers = vec![];
    if let Some(layer) = dense.get(place + 1) {
        readers.push(Folded::dense(weights, layer)?);
    }
    if place + 1 == network.block1.len() {
        readers.push(Folded::up(weights, &network.up1)?);
    }
    if place + 1 == dense.len() {
        readers.push(Folded::up(weights, &network.up2)?);
    }
    Ok(readers)
}

/// The layer that reads the map as one that reads `channels`: their heights, which are innermost, become taps.
fn unfolded(layer: Folded, channels: usize) -> Folded {
    let depth = layer.cin / channels.max(1);
    let row = |tap: usize, channel: usize| {
        let (tap, z) = (tap / depth, tap % depth);
        let row = tap * layer.cin + channel * depth + z;
        &layer.weights[row * layer.cout..][..layer.cout]
    };
    let taps = layer.taps * depth;
    let rows = (0..taps).flat_map(|tap| (0..channels).map(move |channel| (tap, channel)));
    Folded {
        taps,
        cin: channels,
        cout: layer.cout,
        weights: rows
            .flat_map(|(tap, channel)| row(tap, channel))
            .copied()
            .collect(),
        bias: layer.bias.clone(),
    }
}

impl Histograms {
    fn channels(&self) -> Vec<Channel<'_>> {
        let counts = self.counts.chunks_exact(BINS);
        counts.map(Channel::new).collect()
    }
}
