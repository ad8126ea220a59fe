//! `mluc-lab quantize`: prepares a model for int8.

use super::terminal::{counted, print_err, write_out};
use clap::{Args, builder::RangedU64ValueParser};
use mluc_backbone::Precision;
use mluc_dataset::Dataset;
use mluc_evaluate::pipeline::{folder_tail, scan_points};
use mluc_model::{Manifest, Model, WeightSet, model_bytes};
use mluc_train::{TrainError, export::empty_objectness_max, quantize::measure_ranges};
use std::path::{Path, PathBuf};

/// Number of frames for measuring the ranges.
pub(super) const RANGE_FRAMES: usize = 48;

/// Measure the ranges of the values between a model's layers on scans, and store them in a model file, so that it runs with
/// `--precision int8`.
///
/// The weights stay as they are, and f32 and bf16 results with them. Take scans like those the model will see: its
/// training or validation data. Labels are not needed. `evaluate model --precision int8` says what it costs.
#[derive(Args)]
pub(crate) struct QuantizeArguments {
    /// Model file.
    #[arg(long, value_name = "FILE")]
    model: PathBuf,
    /// Folder of scans in KITTI's format: DIR/velodyne/*.bin, or DIR/*.bin.
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// Only the frames that ImageSets/SPLIT.txt names [default: all scans].
    #[arg(long)]
    split: Option<String>,
    /// Frames to measure, evenly spaced.
    #[arg(long, default_value_t = RANGE_FRAMES, value_parser = RangedU64ValueParser::<usize>::new().range(1..), value_name = "N")]
    frames: usize,
    /// Where the model goes with what was measured; may be the same file.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

pub(crate) fn run(arguments: QuantizeArguments) -> anyhow::Result<()> {
    let model = Model::read(&arguments.model)?;
    let dataset = Dataset::open_split(&arguments.data, arguments.split.as_deref())?;
    let (manifest, weights) = quantized(&model, &dataset, &arguments.data, arguments.frames)?;
    let bytes = model_bytes(&manifest, &weights)?;
    print_err(&manifest.provenance.calibration);
    write_out(&arguments.out, &bytes)
}

/// A model with ranges measured on `frames` of a data set, evenly spaced from the first frame; `data` is its folder. Its provenance
/// states how they were chosen.
pub(super) fn quantized(
    model: &Model,
    dataset: &Dataset,
    data: &Path,
    frames: usize,
) -> anyhow::Result<(Manifest, WeightSet)> {
    let names = dataset.names();
    let (all, count) = (names.len(), frames.min(names.len()));
    let distance = all as f64 / count.max(1) as f64;
    let weights = counted("ranges", count, |step| {
        let scans = (0..count).map(|i| {
            step();
            // The points as the stages get them.
            let points = scan_points(dataset, &names[(i as f64 * distance) as usize])?;
            Ok::<Vec<[f32; 4]>, TrainError>(bytemuck::cast_slice(&points).to_vec())
        });
        measure_ranges(&model.manifest, &model.weights, scans)
    })?;
    let mut manifest = model.manifest.clone();
    // Remove the figures for the old ranges: `--precision auto` must not use them.
    for name in Precision::Int8.metrics() {
        manifest.provenance.metrics.remove(&name);
    }
    let folder = folder_tail(&data.canonicalize().unwrap_or(data.to_owned()));
    manifest.provenance.calibration = format!(
        "{count} of {all} frames of {folder}; ranges hold a quarter more than what was seen"
    );
    // Weights that are a mean of others do not have this value yet.
    manifest.empty_objectness_max = empty_objectness_max(&manifest, &weights)?;
    Ok((manifest, weights))
}
