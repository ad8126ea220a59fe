//! `mluc-lab evaluate model`: the whole pipeline over labelled scans.

use super::{report::Outcome, unknown_labelled, warn_unrecognized};
use crate::commands::terminal::{counted, one_of, print_out};
use anyhow::ensure;
use clap::{Args, builder::RangedU64ValueParser};
use mluc_backbone::Precision;
use mluc_evaluate::pipeline::{DetectedFrame, write_threshold};
use mluc_evaluate::pipeline::{FrameSet, ModelGate, choose_profiles, choose_threshold};
use mluc_evaluate::pipeline::{detect_frames, judge, paper_rules, read_parts, sweep_gate};
use mluc_evaluate::pipeline::{unknown_classes, write_part, write_precisions, write_profiles};
use mluc_model::{Manifest, Model};
use mluc_refiner::{Settings, Variant};
use mluc_simulate::shard;
use std::{collections::BTreeSet, path::PathBuf};

/// Run a model over labelled scans, in one process, and evaluate the result.
///
/// Known classes are the model's, at the paper's overlaps for its setting (udi, any: car, pedestrian, cyclist 0.5, truck 0.7; kitti: car 0.7, pedestrian and cyclist
/// 0.5); unknown objects at 0.1. Figures are of volumes (3d) at moderate, by range and by rings at hard. Printed: each class without the gate (closed set) and at the model's threshold;
/// how well each score of a box tells unknown from known; AP by range and by the sensor's rings on the object. --sweep tries many thresholds of the gate.
#[derive(Args)]
pub(crate) struct ModelArguments {
    /// Model file.
    #[arg(long, value_name = "FILE")]
    model: PathBuf,
    /// Folder in KITTI's format: velodyne, label_2, calib.
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// Only the first N frames.
    #[arg(long, default_value_t = usize::MAX, hide_default_value = true, value_parser = RangedU64ValueParser::<usize>::new().range(1..), value_name = "N")]
    frames: usize,
    /// Only the frames that ImageSets/SPLIT.txt names [default: all scans].
    #[arg(long)]
    split: Option<String>,
    /// How candidates become unknown objects: paper, its algorithm as printed; paper-corrected, with its sign turned, ground
    /// removed, an oriented box; range-scaled, with a join distance that grows with range; none, the proposal box as it is.
    #[arg(long, value_parser = one_of(&Variant::ALL, Variant::name), default_value = "paper-corrected")]
    refiner: Variant,
    /// Arithmetic of the backbone; int8 needs `mluc-lab quantize` first.
    #[arg(long, default_value_t, value_parser = one_of(&[Precision::F32, Precision::Bf16, Precision::Int8, Precision::Auto], Precision::name))]
    precision: Precision,
    /// Label classes that are unknown; unseen: those of `simulate --unseen` [default: golf_cart,forklift for udi, van,truck for kitti, all four for any, and
    /// car,pedestrian,cyclist,truck; of all these what the model does not know].
    #[arg(long, value_delimiter = ',', value_name = "CLASS,..")]
    unknown: Option<Vec<String>>,
    /// Try thresholds of the gate, and say which is best: the highest harmonic mean that keeps nine tenths of the closed set's mAP; of an open head one half.
    #[arg(long)]
    sweep: bool,
    /// Write the best threshold into the model file, with how it was chosen (implies --sweep and, where --refiner is range-scaled,
    /// --write-precisions and --write-profiles; else profiles and probabilities of another threshold, and the figures of bf16 and int8, are removed).
    #[arg(long)]
    write_threshold: bool,
    /// Write the scores of the operating profiles into the model file: the lowest at which the upper 95 % bound of the objects per scan on
    /// no label is at most 0.1 unknown (in each third of the scans by their points) and 0.2 known (quiet), 0.3 and 0.5 (balanced).
    /// And how likely an object is one, by score and range. Scans count as independent: those of one drive give scores that are too low.
    /// Needs --refiner range-scaled, as a run has it.
    #[arg(long)]
    write_profiles: bool,
    /// Write into the model file what it reaches in f32, bf16 and int8 (where it has a calibration), at its threshold: `--precision auto`
    /// of a run chooses by these figures. Needs --refiner range-scaled.
    #[arg(long)]
    write_precisions: bool,
    /// Run the network on part I (0 to N-1) of N alone, every Nth frame, for job arrays; needs --write-part.
    #[arg(long, value_name = "I/N", value_parser = shard, requires = "write_part")]
    shard: Option<[u32; 2]>,
    /// Write what the network finds to a file, and evaluate nothing.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["parts", "sweep", "json", "write_threshold", "write_profiles", "write_precisions"])]
    write_part: Option<PathBuf>,
    /// Files of --write-part, which have all frames together: evaluate them. The outcome is that of one run, bit for bit.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    parts: Vec<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: ModelArguments) -> anyhow::Result<()> {
    let path = &arguments.model;
    let model = Model::read(path)?;
    let has_profiles = arguments.refiner == Variant::default();
    ensure!(
        has_profiles || !(arguments.write_profiles || arguments.write_precisions),
        "--write-profiles, --write-precisions: expected --refiner {}, found {}",
        Variant::default().name(),
        arguments.refiner.name()
    );
    let (split, shard) = (arguments.split.as_deref(), arguments.shard);
    let set = FrameSet::open(&arguments.data, split, arguments.frames)?;
    let set = shard.map_or(set.clone(), |shard| set.shard(shard));
    let settings = Settings::of(arguments.refiner);
    // The parts of two processors must have the same precision.
    let (precision, _) = arguments.precision.chosen(&model.manifest, &model.weights);
    let detected = || match arguments.parts.as_slice() {
        [] => {
            let detect = |step: &(dyn Fn() + Sync)| detect_frames(precision, &model, &set, step);
            counted("network", set.names().len(), detect)
        }
        parts => read_parts(parts, &model, precision, &set),
    };
    if let Some(path) = &arguments.write_part {
        let frames = detected()?;
        write_part(path, &model, precision, &set, &frames)?;
        let count = frames.len();
        return print_out(format_args!("{}: {count} frames", path.display()));
    }
    // The classes are checked first: the network may take hours.
    let truths: Result<Vec<_>, _> = (0..set.names().len()).map(|at| set.truth(at)).collect();
    let truths = truths?;
    let labels = || truths.iter().flat_map(|truth| truth.labels.iter());
    let unknown = match &arguments.unknown {
        Some(classes) => unknown_labelled(labels(), classes)?,
        None => unknown_to(&model.manifest),
    };
    paper_rules(&model.manifest.name, &model.manifest.class_names(), &unknown)?;
    let frames = detected()?;
    let judgement = judge(&model, &set, &frames, &unknown, &settings)?;
    warn_unrecognized(labels(), &judgement.rules);
    let lacks = arguments.write_threshold && judgement.unknown_labels() == 0;
    let classes = unknown.join(", ");
    ensure!(!lacks, "--write-threshold: no label of {classes} counts");
    let is_swept = arguments.sweep || arguments.write_threshold;
    let sweep = is_swept.then(|| {
        counted("thresholds", set.names().len(), |step| {
            sweep_gate(&model, &set, &frames, &judgement.rules, &settings, step)
        })
    });
    let sweep = sweep.transpose()?;
    let mut outcome = Outcome {
        model,
        data: set.describe(),
        frames: set.names().len(),
        judgement,
        sweep,
        choice: None,
        profiles: None,
    };
    write_choices(&arguments, &set, &frames, &unknown, &mut outcome)?;
    if arguments.json {
        return print_out(format_args!("{:#}", outcome.to_json()));
    }
    print_out(outcome.to_table().trim_end())
}

/// The classes that the paper excludes in the model's setting, and the usual known ones, without those that the model knows.
fn unknown_to(manifest: &Manifest) -> Vec<String> {
    // An adapted model may know some of these classes, and lack some that other models know.
    let mut seen: BTreeSet<String> = manifest.class_names().into_iter().collect();
    let mut classes = unknown_classes(&manifest.name);
    if !classes.is_empty() {
        let others = ["car", "pedestrian", "cyclist", "truck"];
        classes.extend(others.map(str::to_owned));
    }
    classes.retain(|class| seen.insert(class.clone()));
    classes
}

/// Chooses what the options ask to write (threshold, profiles, precisions) and writes it into the model file; adds the choices to the outcome.
fn write_choices(
    arguments: &ModelArguments,
    set: &FrameSet,
    frames: &[DetectedFrame],
    unknown: &[String],
    outcome: &mut Outcome,
) -> anyhow::Result<()> {
    let (path, settings) = (&arguments.model, Settings::of(arguments.refiner));
    let (model, judgement) = (&outcome.model, &outcome.judgement);
    if let (Some(sweep), true) = (&outcome.sweep, arguments.write_threshold) {
        let (gate, variant) = (ModelGate::of(model), settings.variant.name());
        let chosen = choose_threshold(gate, sweep, judgement, &outcome.data, variant);
        write_threshold(path, model, &chosen)?;
        outcome.choice = Some(chosen);
    }
    let writes_all = arguments.write_threshold && arguments.refiner == Variant::default();
    if arguments.write_profiles || writes_all {
        let model = Model::read(path)?;
        let chosen = choose_profiles(&model, set, frames, &judgement.rules, &settings)?;
        write_profiles(path, &model, &chosen, &outcome.data)?;
        outcome.profiles = Some(chosen);
    }
    if arguments.write_precisions || writes_all {
        let count = Precision::ALL.len() * set.names().len();
        counted("precisions", count, |step| write_precisions(path, set, unknown, &settings, step))?;
    }
    Ok(())
}
