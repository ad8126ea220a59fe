//! How large the values between the layers get, for [`mluc_backbone::Precision::Int8`].
//!
//! Each channel has a histogram of its values (they are not negative) over equal steps of the logarithm. Its range holds
//! every value seen and some more; how much more is balanced against the weights that read it ([`super::equalize`]).

use mluc_backbone::{Backbone, Coverage, Level};
use mluc_model::{Folded, Manifest, ModelError, Network, WeightSet, calibrated_layers};

use super::equalize::equalized;
use super::histogram::{BINS, bin};
use crate::error::TrainError;

/// What was seen of a level: its name and, of each channel, a histogram.
type Histograms = (String, Vec<[u64; BINS]>);

/// `weights` with a range for each channel between the layers, measured on `scans` (x, y, z in m, intensity) in f32. Take scans
/// like those to come. A channel that was 0 in every frame gets the largest range of its level: whatever it holds one day will
/// fit. An error where nothing but 0 was seen at some level.
pub fn measure_ranges<S: AsRef<[[f32; 4]]>>(
    manifest: &Manifest,
    weights: &WeightSet,
    scans: impl IntoIterator<Item = Result<S, TrainError>>,
) -> Result<WeightSet, TrainError> {
    let network = &manifest.network;
    let layers = calibrated_layers(network).into_iter();
    let empty = |(level, channels)| (level, vec![[0; BINS]; channels]);
    let mut levels: Vec<Histograms> = layers.map(empty).collect();
    let mut backbone = Backbone::new(manifest, weights)?;
    let mut frames = 0;
    for scan in scans {
        let observe = &mut |level: Level| count(&mut levels, level);
        backbone.run_observed(scan?.as_ref(), Coverage::Active, observe);
        frames += 1;
    }
    let mut weights = weights.clone();
    weights.remove_calibration(network);
    for (number, (level, seen)) in levels.iter().enumerate() {
        let readers = readers(network, &weights, number)?;
        let range = equalized(seen, &readers).ok_or_else(|| {
            TrainError::Stopped(format!(
                "the data: expected scans with points inside the model's range, found {frames} frames that leave a layer at 0"
            ))
        })?;
        weights.set_range(level, range);
    }
    Ok(weights)
}

/// Counts the values of a level; levels that stay as they are in int8 are passed over.
fn count(levels: &mut [Histograms], level: Level) {
    let mut levels = levels.iter_mut();
    let Some((_, seen)) = levels.find(|(name, _)| name == level.name) else {
        return;
    };
    for row in level.values.chunks_exact(seen.len()) {
        for (counts, value) in seen.iter_mut().zip(row) {
            if let Some(bin) = bin(*value) {
                counts[bin] += 1;
            }
        }
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
        let reader = if let Some(layer) = network.sparse.get(number + 1) {
            Folded::sparse(weights, layer)?
        } else {
            let layer = Folded::dense(weights, dense[0])?;
            unfolded(layer, network.sparse[number].cout)
        };
        return Ok(vec![reader]);
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
    let weights = rows.flat_map(|(tap, channel)| row(tap, channel));
    Folded {
        taps,
        cin: channels,
        cout: layer.cout,
        weights: weights.copied().collect(),
        bias: layer.bias.clone(),
    }
}
