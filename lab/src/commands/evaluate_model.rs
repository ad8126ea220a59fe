//! `mluc-lab evaluate model`: the whole pipeline over labelled scans.

use super::evaluate::{Neighbours, warn_unheard};
use anyhow::{Context, bail};
use clap::{Args, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use mluc_backbone::Precision;
use mluc_lab::pipeline::{
    Choice, DetectedFrame, FrameSet, Gate, GateSweep, Judgement, choose_threshold,
    detect_frames_in, judge, sweep_gate, unknown_classes, write_threshold,
};
use mluc_model::Model;
use mluc_refiner::{Mode, Settings};
use serde_json::json;
use std::io::Write;
use std::path::PathBuf;

/// Run a model over labelled scans, in one process, and judge what comes out.
///
/// Known classes are the model's, at the paper's overlaps for its setting (udi: car, pedestrian, cyclist 0.5, truck 0.7;
/// kitti: car 0.7, pedestrian and cyclist 0.5); unknown objects at 0.1. All figures are of volumes (3d) at moderate.
/// Printed: each class without the gate (closed set) and at the model's threshold; how well each score of a box tells
/// unknown from known; what became of each label. --sweep tries many thresholds of the gate.
#[derive(Args)]
pub(super) struct ModelArguments {
    /// Model file.
    #[arg(long, value_name = "FILE")]
    model: PathBuf,
    /// Folder in KITTI's format: velodyne, label_2, calib.
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// Only the frames that ImageSets/SPLIT.txt names [default: all scans].
    #[arg(long)]
    split: Option<String>,
    /// First so many frames.
    #[arg(long, default_value_t = usize::MAX, hide_default_value = true, value_name = "N")]
    frames: usize,
    /// How candidates become unknown objects.
    #[arg(long, value_enum, default_value_t = RefinerName::Corrected)]
    refiner: RefinerName,
    /// Of the backbone: f32, bf16 or int8 (after `mluc-lab quantize`).
    #[arg(long, default_value_t)]
    precision: Precision,
    /// Label classes that are unknown [default: golf_cart,forklift for udi, van,truck for kitti].
    #[arg(long, value_delimiter = ',', value_name = "CLASS,..")]
    unknown: Option<Vec<String>>,
    /// What look-alikes are (a van found as a car): official, neither right nor wrong; strict, wrong.
    #[arg(long, value_enum, default_value_t = Neighbours::Official)]
    neighbours: Neighbours,
    /// Try thresholds of the gate, and say which is best: the highest harmonic mean that keeps nine tenths of the closed
    /// set's mAP.
    #[arg(long)]
    sweep: bool,
    /// Write the best threshold into the model file, with how it was chosen (implies --sweep).
    #[arg(long)]
    write_threshold: bool,
    /// Write the kept boxes with every score, one JSON line a frame.
    #[arg(long, value_name = "FILE.jsonl")]
    boxes: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum RefinerName {
    /// The paper's algorithm with its sign turned, ground removed, an oriented box.
    Corrected,
    /// The paper's algorithm to the letter.
    Literal,
    /// Join distance that grows with range.
    Distance,
    /// The proposal box as it is: the metric head alone.
    None,
}

impl RefinerName {
    fn mode(self) -> Mode {
        match self {
            RefinerName::Corrected => Mode::Corrected,
            RefinerName::Literal => Mode::Literal,
            RefinerName::Distance => Mode::Distance,
            RefinerName::None => Mode::None,
        }
    }
}

/// Everything that was found out.
struct Outcome {
    model: Model,
    data: String,
    frames: usize,
    judgement: Judgement,
    sweep: Option<GateSweep>,
    choice: Option<Choice>,
}

/// Runs it.
pub(super) fn run(arguments: ModelArguments) -> anyhow::Result<()> {
    if arguments.frames == 0 {
        bail!("--frames: expected 1 or more, found 0");
    }
    let model = Model::read(&arguments.model)?;
    let set = FrameSet::open(
        &arguments.data,
        arguments.split.as_deref(),
        arguments.frames,
    )?;
    let settings = Settings {
        mode: arguments.refiner.mode(),
        ..Settings::default()
    };
    let unknown = match &arguments.unknown {
        Some(classes) => classes.clone(),
        None => unknown_classes(&model.manifest.name),
    };
    let bar = bar("network", set.len());
    let frames = detect_frames_in(arguments.precision, &model, &set, || bar.inc(1))?;
    bar.finish_and_clear();
    if let Some(path) = &arguments.boxes {
        write_boxes(path, &model, &set, &frames)?;
    }
    let judgement = judge(
        &model,
        &set,
        &frames,
        &unknown,
        arguments.neighbours.policy(),
        &settings,
    )?;
    let labels = frames.iter().flat_map(|frame| frame.truth.labels.iter());
    warn_unheard(labels, &judgement.rules);
    let sweep = if arguments.sweep || arguments.write_threshold {
        let bar = self::bar("thresholds", set.len());
        let step = || bar.inc(1);
        let swept = sweep_gate(&model, &set, &frames, &judgement.rules, &settings, step)?;
        bar.finish_and_clear();
        Some(swept)
    } else {
        None
    };
    let choice = match (&sweep, arguments.write_threshold) {
        (Some(sweep), true) => Some(choose_threshold(
            Gate::of(&model),
            sweep,
            &judgement,
            &set.describe(),
            settings.mode.name(),
        )?),
        _ => None,
    };
    if let Some(choice) = &choice {
        write_threshold(&arguments.model, &model, choice)?;
    }
    let (data, frames) = (set.describe(), set.len());
    let outcome = Outcome {
        model,
        data,
        frames,
        judgement,
        sweep,
        choice,
    };
    let text = match arguments.json {
        true => serde_json::to_string_pretty(&outcome.to_json()).context("JSON of the figures")?,
        false => outcome.to_table(),
    };
    writeln!(std::io::stdout(), "{}", text.trim_end()).context("standard output")
}

/// On stderr, and only where that is a terminal.
fn bar(what: &'static str, frames: usize) -> ProgressBar {
    let bar = ProgressBar::new(frames as u64);
    let style = "{msg} [{bar:40}] {pos}/{len} frames, {per_sec}, {eta} left";
    if let Ok(style) = ProgressStyle::with_template(style) {
        bar.set_style(style);
    }
    bar.with_message(what)
}

fn write_boxes(
    path: &std::path::Path,
    model: &Model,
    set: &FrameSet,
    frames: &[DetectedFrame],
) -> anyhow::Result<()> {
    let failed = || format!("{}: cannot be written", path.display());
    let mut file = std::io::BufWriter::new(std::fs::File::create(path).with_context(failed)?);
    let classes = &model.manifest.classes;
    for (name, frame) in set.names().iter().zip(frames) {
        let boxes = frame.detections.iter().map(|d| {
            json!({
                "label": classes.get(d.class_id as usize).map(|class| &class.name),
                "center_m": d.center_m, "size_m": d.size_m, "yaw_rad": d.yaw_rad,
                "objectness": d.objectness, "score": d.score,
                "probabilities": &d.probabilities[..classes.len()], "embedding": &d.embedding[..classes.len()],
                "e": d.eds_normalised, "e_perp": d.eds_perpendicular, "delta": d.delta,
                "msp": d.softmax_max, "max_logit": d.logit_max, "energy": d.energy,
            })
        });
        let line = json!({"frame": name, "boxes": boxes.collect::<Vec<_>>()});
        writeln!(file, "{line}").with_context(failed)?;
    }
    file.flush().with_context(failed)
}

mod report;
