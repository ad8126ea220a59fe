//! The ranges of int8: collected from scans, put into a model, judged by how far the outputs move.
//!
//! [`calibrate`] runs the network in f32 over some frames and chooses a range for each channel between the layers
//! ([`measure_ranges`]). [`compare`] runs other frames in every precision and gives the errors against f32.

mod calibrator;
mod compare;
mod equalize;
mod histogram;

pub use calibrator::measure_ranges;
pub use compare::{OutputErrors, compare};

use mluc_dataset::Dataset;
use mluc_evaluate::pipeline::scan_points;
use mluc_model::{Manifest, Model, WeightSet, calibrated_layers};

use crate::error::TrainError;

/// A model with ranges, and how they look.
#[derive(Clone, Debug)]
pub struct Calibrated {
    /// Its provenance says how the ranges were chosen.
    pub manifest: Manifest,
    /// With a range for each channel.
    pub weights: WeightSet,
    /// In the order of computation.
    pub levels: Vec<LevelRange>,
}

/// The ranges of one level.
#[derive(Clone, Debug, PartialEq)]
pub struct LevelRange {
    /// The layer's name.
    pub level: String,
    /// How many.
    pub channels: usize,
    /// The smallest, the middle and the largest range of a channel, in the level's own unit.
    pub ranges: [f32; 3],
}

/// `count` of the frames, evenly spaced, beginning with the first; all where there are fewer. `shift`: takes those that
/// lie so far after them, in parts of the distance (0.5: half way between).
pub fn evenly(names: &[String], count: usize, shift: f64) -> Vec<String> {
    let count = count.min(names.len());
    let distance = names.len() as f64 / count.max(1) as f64;
    let place = |i: usize| ((i as f64 + shift) * distance) as usize;
    let places = (0..count).map(place);
    places.filter_map(|at| names.get(at).cloned()).collect()
}

/// The points of a frame, as the stages see them.
fn read_points(dataset: &Dataset, name: &str) -> Result<Vec<[f32; 4]>, TrainError> {
    let points = scan_points(dataset, name)?;
    Ok(bytemuck::cast_slice(&points).to_vec())
}

/// Ranges from `frames` of a data set. `describe`: how they were picked, for the model's provenance. `step` is called
/// after each.
pub fn calibrate(
    model: &Model,
    dataset: &Dataset,
    frames: &[String],
    describe: &str,
    mut step: impl FnMut(),
) -> Result<Calibrated, TrainError> {
    let mut manifest = model.manifest.clone();
    let scans = frames.iter().map(|name| {
        step();
        read_points(dataset, name)
    });
    let weights = measure_ranges(&manifest, &model.weights, scans)?;
    manifest.provenance.calibration =
        format!("{describe}; ranges hold a quarter more than what was seen");
    let levels = calibrated_layers(&manifest.network).into_iter();
    let range = |(level, channels): (String, usize)| {
        let mut sorted = weights.range(&level, channels)?.to_vec();
        sorted.sort_by(f32::total_cmp);
        Ok(LevelRange {
            ranges: [0, channels / 2, channels - 1].map(|at| sorted[at]),
            level,
            channels,
        })
    };
    let levels = levels.map(range).collect::<Result<_, TrainError>>()?;
    Ok(Calibrated {
        manifest,
        weights,
        levels,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_spread_and_the_judging_ones_lie_between() {
        let names: Vec<String> = (0..10).map(|i| i.to_string()).collect();
        assert_eq!(evenly(&names, 3, 0.0), ["0", "3", "6"]);
        assert_eq!(evenly(&names, 3, 0.5), ["1", "5", "8"]);
        assert_eq!(evenly(&names, 20, 0.0), names);
        assert!(evenly(&[], 5, 0.0).is_empty());
    }
}
