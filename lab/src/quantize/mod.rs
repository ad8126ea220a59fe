//! The ranges of int8: collected from scans, put into a model, judged by how far the outputs move.
//!
//! [`calibrate`] runs the network in f32 over some frames and chooses a range for each channel between the layers
//! ([`Calibrator`] says how). [`compare`] runs other frames in every precision and gives the errors against f32.

mod compare;
mod error;

pub use compare::{OutputErrors, compare};
pub use error::QuantizeError;

use crate::dataset::Dataset;
use crate::pipeline::scan_points;
use mluc_backbone::{Backbone, Calibrator, Coverage};
use mluc_model::{Manifest, Model, WeightSet, calibrated_layers};

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

/// Ranges from `frames` of a data set. `describe`: how they were picked, for the model's provenance. `step` is called
/// after each.
pub fn calibrate(
    model: &Model,
    dataset: &Dataset,
    frames: &[String],
    describe: &str,
    mut step: impl FnMut(),
) -> Result<Calibrated, QuantizeError> {
    let (mut manifest, mut weights) = (model.manifest.clone(), model.weights.clone());
    let mut backbone = Backbone::new(&manifest, &weights)?;
    let mut calibrator = Calibrator::new(&manifest.network);
    for name in frames {
        let points = scan_points(dataset, name)?;
        let observe = &mut |level: mluc_backbone::Level| calibrator.observe(level);
        backbone.run_observed(bytemuck::cast_slice(&points), Coverage::Active, observe);
        step();
    }
    weights.remove_calibration(&manifest.network);
    if !calibrator.write(&manifest.network, &mut weights)? {
        return Err(QuantizeError::NothingSeen {
            frames: frames.len(),
        });
    }
    manifest.provenance.calibration =
        format!("{describe}; ranges hold a quarter more than what was seen");
    let levels = levels(&manifest, &weights)?;
    Ok(Calibrated {
        manifest,
        weights,
        levels,
    })
}

fn levels(manifest: &Manifest, weights: &WeightSet) -> Result<Vec<LevelRange>, QuantizeError> {
    let levels = calibrated_layers(&manifest.network).into_iter();
    let range = |(level, channels): (String, usize)| {
        let mut sorted = weights.range(&level, channels)?.to_vec();
        sorted.sort_by(f32::total_cmp);
        let ranges = [0, channels / 2, channels - 1].map(|at| sorted[at]);
        Ok(LevelRange {
            level,
            channels,
            ranges,
        })
    };
    levels.map(range).collect()
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
