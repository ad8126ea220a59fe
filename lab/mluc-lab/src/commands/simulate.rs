//! `mluc-lab simulate`: writes a simulated data set.

use super::terminal::{Progress, Threads, one_of, print_out};
use anyhow::Context;
use clap::Args;
use mluc_model::SensorProfile;
use mluc_simulate::{Class, ExportOptions, Family, Realism, Split, Step, export};
use std::path::PathBuf;

/// Write simulated, labelled scans as a KITTI-format folder.
///
/// DIR gets velodyne/, label_2/, calib/, planes/, instances/ and ImageSets/SPLIT.txt, for one split. Give each split a folder of its own, for example
/// data/sim-udi/train and data/sim-udi/val. The same family, split and seed give the same bytes, with any number of threads; a longer run begins with the
/// frames of a shorter one.
#[derive(Args)]
pub(crate) struct SimulateArguments {
    /// Scenes: sim-udi (full circle), sim-kitti (forward half, with a camera) or sim-any (full circle, each frame by another sensor).
    #[arg(long, value_parser = one_of(&Family::ALL, Family::name))]
    family: Family,
    /// train shows known classes alone (see --synthetic-unknown); val and test also unknown ones.
    #[arg(long, value_parser = one_of(&Split::ALL, Split::name))]
    split: Split,
    /// Number of frames.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    frames: u32,
    /// Seed of the data set.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Scan with this sensor: a product of `sensors/`, or a TOML file like those [default: the family's].
    #[arg(long, value_name = "NAME|FILE")]
    sensor: Option<String>,
    /// Scan the same scenes by this sensor too, from the same place, into OUT-pair.
    #[arg(long, value_name = "NAME|FILE", conflicts_with = "sequence")]
    pair: Option<String>,
    /// Frames of a sequence at 10 Hz through one scene, in which the sensor and half of the objects move [default: every frame is a scene of its own].
    /// Adds poses.txt and timestamps.txt; the frames that come first are not those of a data set without sequences.
    #[arg(long, value_parser = clap::value_parser!(u32).range(2..=100))]
    sequence: Option<u32>,
    /// Folder to write; must be new or empty.
    #[arg(long)]
    out: PathBuf,
    /// Leave out steps that bring simulated scans closer to recorded ones, to measure what they are worth (comma separated): rings (uneven beams, phases, two
    /// origins), noise, drop (lost returns, rays through windows), sizes (every object of a class at its mean size, exact labels), confusers (things of a car's
    /// size that are none). Not for training a model that is to be used.
    #[arg(
        long,
        value_parser = one_of(&Step::ALL, Step::name),
        value_delimiter = ',',
        value_name = "STEP,..",
        hide_possible_values = true
    )]
    without: Vec<Step>,
    /// Put objects among the known ones that are made up of them, resized and joined, labelled Synthetic_unknown: what
    /// `metric-open` and `mluc-full` learn the unknown from. For --split train alone.
    #[arg(long)]
    synthetic_unknown: bool,
    /// Show the unseen classes of the split in place of the family's unknown ones; judge with `evaluate model --unknown unseen`. Not for --split train.
    #[arg(long)]
    unseen: bool,
    /// Classes that stand in every split, train too, beside the family's known ones: van, truck, golf_cart, forklift.
    #[arg(long, value_delimiter = ',', value_parser = class, value_name = "CLASS,..")]
    known: Vec<Class>,
    #[command(flatten)]
    threads: Threads,
}

/// A class by its name, whatever the case of its letters.
pub(super) fn class(text: &str) -> Result<Class, String> {
    let found = Class::REAL
        .into_iter()
        .find(|c| c.name().eq_ignore_ascii_case(text));
    found.ok_or_else(|| {
        let names = Class::REAL
            .map(|c| c.name().to_ascii_lowercase())
            .join(", ");
        format!("expected one of {names}, found '{text}'")
    })
}

pub(crate) fn run(arguments: SimulateArguments) -> anyhow::Result<()> {
    let load = |name: Option<String>| name.map(|name| SensorProfile::load(&name)).transpose();
    let scanned_by = load(arguments.pair)?.map(Box::new);
    let mut options = ExportOptions {
        family: arguments.family,
        split: arguments.split,
        frames: arguments.frames,
        sequence: arguments.sequence,
        seed: arguments.seed,
        sensor: load(arguments.sensor)?,
        scanned_by: None,
        realism: Realism::without(&arguments.without),
        synthetic_unknown: arguments.synthetic_unknown,
        unseen: arguments.unseen,
        also_known: arguments.known,
        folder: arguments.out,
        resume: false,
        threads: arguments.threads.threads,
    };
    let name = export_with_progress(&options)?;
    if scanned_by.is_some() {
        options.scanned_by = scanned_by;
        let mut pair = options.folder.clone().into_os_string();
        pair.push("-pair");
        let first = std::mem::replace(&mut options.folder, pair.into());
        export_with_progress(&options)?;
        options.folder = first;
    }
    let (realism, folder) = (options.realism, options.folder.display());
    let total = options.frames;
    print_out(format_args!("{name}{realism}: {total} frames in {folder}"))
}

/// Simulates, shows how far it is, and gives the name of what was simulated.
pub(super) fn export_with_progress(options: &ExportOptions) -> anyhow::Result<String> {
    let name = format!("{} {}", options.family.name(), options.split.name());
    let total = u64::from(options.frames);
    let style = "{msg} [{bar:40}] {pos}/{len} {per_sec}, {eta} left";
    let progress = Progress::new(&name, total, style);
    let step = || {
        progress.bar.inc(1);
        let done = progress.bar.position();
        progress.line(done == total, format_args!("{done}/{total} frames"));
    };
    export(options, step).with_context(|| format!("simulating {name}"))?;
    progress.bar.finish_and_clear();
    Ok(name)
}
