//! Ranges of the values between the layers, for [`mluc_backbone::Precision::Int8`].
//!
//! The quantisation step of a channel is multiplied into the weights that read it (as in the backbone), and a layer's weights of one
//! output channel share one step. With its own range a channel is rounded finely, but a channel that is rarely large makes its
//! weights large, and the step coarse for all others. The other extreme is one range for the whole level. A channel's range is
//! the geometric mean of the two: the balance of SmoothQuant (Xiao et al., ICML 2023) at its usual strength of one half.

use crate::error::TrainError;
use mluc_backbone::{Backbone, Coverage, Level};
use mluc_model::{Manifest, WeightSet, calibrated_layers};

/// Minimum ratio of a channel's range to its largest value seen. Later scans have larger values; clipping costs far more than finer steps gain.
const MARGIN: f32 = 1.25;

/// `weights` with a range for each channel between the layers, measured on `scans` (x, y, z in m, intensity) in f32. Use scans like those in operation. A
/// channel that was 0 in every frame gets the largest range of its level, which fits any later value. Returns an error where all values of a level were 0.
pub fn measure_ranges<S: AsRef<[[f32; 4]]>>(
    manifest: &Manifest,
    weights: &WeightSet,
    scans: impl IntoIterator<Item = Result<S, TrainError>>,
) -> Result<WeightSet, TrainError> {
    let network = &manifest.network;
    let layers = calibrated_layers(network).into_iter();
    let empty = |(level, channels)| (level, vec![0.0; channels]);
    let mut levels: Vec<(String, Vec<f32>)> = layers.map(empty).collect();
    let mut backbone = Backbone::new(manifest, weights)?;
    let mut frames = 0;
    for scan in scans {
        let observe = &mut |level: Level| widen(&mut levels, level);
        backbone.run_observed(scan?.as_ref(), Coverage::Active, observe);
        frames += 1;
    }
    let mut weights = weights.clone();
    weights.remove_calibration(network);
    for (level, largest) in &levels {
        let ranges = ranges(largest).ok_or_else(|| {
            TrainError::Input(format!(
                "the data: expected scans with points inside the model's range, found {frames} frames that leave a layer at 0"
            ))
        })?;
        weights.set_range(level, ranges);
    }
    Ok(weights)
}

/// Updates the largest values of a level's channels; levels that are not quantised in int8 are skipped.
fn widen(levels: &mut [(String, Vec<f32>)], level: Level) {
    let mut levels = levels.iter_mut();
    let Some((_, largest)) = levels.find(|(name, _)| name == level.name) else {
        return;
    };
    for row in level.values.chunks_exact(largest.len()) {
        largest.iter_mut().zip(row).for_each(|(largest, value)| *largest = largest.max(*value));
    }
}

/// A range for each channel from its largest value; `None` where every value was 0.
fn ranges(largest: &[f32]) -> Option<Vec<f32>> {
    let level = largest.iter().copied().fold(0.0, f32::max);
    let range = |own: &f32| match *own {
        0.0 => MARGIN * level,
        own => MARGIN * (own * level).sqrt(),
    };
    (level > 0.0).then(|| largest.iter().map(range).collect())
}
