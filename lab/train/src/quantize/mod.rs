//! The ranges of int8: collected from scans, put into a model. [`calibrate`] runs the network in f32 over some frames and chooses a
//! range for each channel between the layers ([`measure_ranges`]).

mod calibrator;

pub use calibrator::measure_ranges;

use mluc_dataset::Dataset;
use mluc_evaluate::pipeline::scan_points;
use mluc_model::{Manifest, Model, WeightSet};

use crate::error::TrainError;

/// A model with ranges.
#[derive(Clone, Debug)]
pub struct Calibrated {
    /// Its provenance says how the ranges were chosen.
    pub manifest: Manifest,
    /// With a range for each channel.
    pub weights: WeightSet,
}

/// `count` of the frames, evenly spaced, beginning with the first; all where there are fewer.
pub fn evenly(names: &[String], count: usize) -> Vec<String> {
    let count = count.min(names.len());
    let distance = names.len() as f64 / count.max(1) as f64;
    let places = (0..count).map(|i| (i as f64 * distance) as usize);
    places.map(|at| names[at].clone()).collect()
}

/// Ranges from `frames` of a data set. `describe`: how they were picked, for the model's provenance. `step` is called after each.
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
        // As the stages see them.
        let points = scan_points(dataset, name)?;
        Ok::<Vec<[f32; 4]>, TrainError>(bytemuck::cast_slice(&points).to_vec())
    });
    let weights = measure_ranges(&manifest, &model.weights, scans)?;
    manifest.provenance.calibration =
        format!("{describe}; ranges hold a quarter more than what was seen");
    Ok(Calibrated { manifest, weights })
}
