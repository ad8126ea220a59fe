//! `mluc-lab quantize`: makes a model fit for int8.

use super::terminal::{at_least_one, counted, print_out};
use anyhow::Context;
use clap::Args;
use mluc_dataset::Dataset;
use mluc_dataset::whole_file::write_whole;
use mluc_evaluate::pipeline::folder_tail;
use mluc_model::{Model, model_bytes};
use mluc_train::quantize::{Calibrated, LevelRange, OutputErrors, calibrate, compare, evenly};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Frames that ranges are measured on.
pub(super) const RANGE_FRAMES: usize = 48;

/// Measure on scans how large the values between a model's layers get, and store it in a model file, so that it runs with
/// `--precision int8`.
///
/// The weights stay as they are, and f32 and bf16 results with them. Take scans like those the model will see: its
/// training or validation data. Labels are not needed. Printed: the ranges of each level, and how far each output of the
/// network moves from f32 on frames that were not measured.
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
    #[arg(long, default_value_t = RANGE_FRAMES, value_parser = at_least_one, value_name = "N")]
    frames: usize,
    /// Frames to compare the precisions on, between those.
    #[arg(long, default_value_t = 8, value_name = "N")]
    check_frames: usize,
    /// Where the model goes with what was measured; may be the same file.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: QuantizeArguments) -> anyhow::Result<()> {
    let model = Model::read(&arguments.model)?;
    let dataset = Dataset::open_split(&arguments.data, arguments.split.as_deref())?;
    let calibrated = quantized(&model, &dataset, &arguments.data, arguments.frames)?;
    let (manifest, weights) = (&calibrated.manifest, &calibrated.weights);
    let bytes = model_bytes(manifest, weights)?;
    // Frames between the measured ones; of a small set they may be the same.
    let others = evenly(dataset.names(), arguments.check_frames, 0.5);
    let errors = if others.is_empty() {
        vec![]
    } else {
        counted("errors", others.len(), |step| {
            compare(manifest, weights, &dataset, &others, step)
        })?
    };
    let out = arguments.out.display();
    write_whole(&arguments.out, &bytes).with_context(|| format!("{out}: cannot be written"))?;
    if arguments.json {
        let json = as_json(&calibrated, &errors, others.len());
        return print_out(format_args!("{json:#}"));
    }
    print_out(as_table(&calibrated, &errors, others.len()).trim_end())
}

/// A model with ranges measured on `frames` of a data set, evenly spaced; `data` is its folder.
pub(super) fn quantized(
    model: &Model,
    dataset: &Dataset,
    data: &Path,
    frames: usize,
) -> anyhow::Result<Calibrated> {
    let frames = evenly(dataset.names(), frames, 0.0);
    let folder = folder_tail(&data.canonicalize().unwrap_or(data.to_owned()));
    let (count, all) = (frames.len(), dataset.names().len());
    let describe = format!("{count} of {all} frames of {folder}");
    Ok(counted("ranges", count, |step| {
        calibrate(model, dataset, &frames, &describe, step)
    })?)
}

fn as_table(calibrated: &Calibrated, errors: &[OutputErrors], frames: usize) -> String {
    let measured_on = &calibrated.manifest.provenance.calibration;
    let mut text = format!("calibration: {measured_on}\n\n");
    text += "level                    channels   smallest     middle    largest\n";
    for level in &calibrated.levels {
        let [smallest, middle, largest] = level.ranges;
        text += &format!(
            "{:24} {:8} {smallest:10.4} {middle:10.4} {largest:10.4}\n",
            level.level, level.channels
        );
    }
    text += &format!("\nerror against f32, of its root mean square, on {frames} frames\n");
    for precision in errors {
        let percent = |(name, error): &(String, f64)| format!("{name} {:.2} %", 100.0 * error);
        let outputs: Vec<_> = precision.outputs.iter().map(percent).collect();
        text += &format!("{:5} {}\n", precision.precision, outputs.join(", "));
    }
    text
}

fn as_json(calibrated: &Calibrated, errors: &[OutputErrors], others: usize) -> Value {
    let level = |level: &LevelRange| {
        let [smallest, middle, largest] = level.ranges;
        json!({"level": level.level, "channels": level.channels, "smallest": smallest,
               "middle": middle, "largest": largest})
    };
    let errors = errors.iter().map(|errors| {
        let outputs = errors.outputs.iter().cloned();
        let outputs: BTreeMap<String, f64> = outputs.collect();
        (errors.precision.name(), outputs)
    });
    json!({
        "calibration": calibrated.manifest.provenance.calibration,
        "levels": calibrated.levels.iter().map(level).collect::<Vec<_>>(),
        "errors": errors.collect::<BTreeMap<_, _>>(),
        "frames_compared": others,
    })
}
