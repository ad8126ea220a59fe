//! `mluc-lab simulate`: writes a simulated data set.

use super::terminal::{answer, tell};
use anyhow::Context;
use clap::{Args, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use mluc_lab::simulate::{ExportOptions, Family, Realism, Split, Step, export};
use std::io::IsTerminal;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, Ordering};

/// Write simulated, labelled scans as a KITTI-format folder.
///
/// DIR gets velodyne/, label_2/, calib/, planes/, instances/ and ImageSets/SPLIT.txt, for one split. Give each split a folder of its own, for example
/// data/sim-udi/train and data/sim-udi/val. The same family, split and seed give the same bytes, with any number of threads; a longer run begins with the
/// frames of a shorter one.
#[derive(Args)]
pub(crate) struct SimulateArguments {
    /// Scenes: sim-udi (full circle) or sim-kitti (forward half, with a camera).
    #[arg(long)]
    family: FamilyName,
    /// train shows known classes alone (see --made-up); val and test also unknown ones.
    #[arg(long)]
    split: SplitName,
    /// Number of frames.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    frames: u32,
    /// Seed of the data set.
    #[arg(long, default_value_t = 1)]
    seed: u64,
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
        value_enum,
        value_delimiter = ',',
        value_name = "STEP,..",
        hide_possible_values = true
    )]
    without: Vec<StepName>,
    /// Put objects among the known ones that are made up of them, resized and joined, labelled Made_up: what
    /// `metric-open` and `improved` learn the unknown from. For --split train alone.
    #[arg(long)]
    made_up: bool,
    /// Threads; 0 takes one per core.
    #[arg(long, default_value_t = 0, value_parser = super::terminal::threads)]
    threads: usize,
}

#[derive(Clone, Copy, ValueEnum)]
enum FamilyName {
    SimUdi,
    SimKitti,
}

#[derive(Clone, Copy, ValueEnum)]
enum SplitName {
    Train,
    Val,
    Test,
}

#[derive(Clone, Copy, ValueEnum)]
enum StepName {
    Rings,
    Noise,
    Drop,
    Sizes,
    Confusers,
}

impl From<StepName> for Step {
    fn from(name: StepName) -> Step {
        match name {
            StepName::Rings => Step::Rings,
            StepName::Noise => Step::Noise,
            StepName::Drop => Step::Drop,
            StepName::Sizes => Step::Sizes,
            StepName::Confusers => Step::Confusers,
        }
    }
}

pub(crate) fn run(arguments: SimulateArguments) -> anyhow::Result<()> {
    let left_out: Vec<Step> = arguments.without.into_iter().map(Step::from).collect();
    let options = ExportOptions {
        family: match arguments.family {
            FamilyName::SimUdi => Family::SimUdi,
            FamilyName::SimKitti => Family::SimKitti,
        },
        split: match arguments.split {
            SplitName::Train => Split::Train,
            SplitName::Val => Split::Val,
            SplitName::Test => Split::Test,
        },
        frames: arguments.frames,
        sequence: arguments.sequence,
        seed: arguments.seed,
        realism: Realism::without(&left_out),
        made_up: arguments.made_up,
        folder: arguments.out,
        threads: arguments.threads,
    };
    let name = format!("{} {}", options.family.name(), options.split.name());
    let progress = Progress::new(&name, options.frames);
    export(&options, || progress.step()).with_context(|| format!("simulating {name}"))?;
    progress.bar.finish_and_clear();
    answer(format_args!(
        "{name}{}: {} frames in {}",
        options.realism,
        options.frames,
        options.folder.display()
    ))
}

/// A bar on a terminal, a line every 5 % elsewhere.
struct Progress {
    bar: ProgressBar,
    lines: bool,
    done: AtomicU32,
    total: u32,
}

impl Progress {
    fn new(name: &str, total: u32) -> Progress {
        let lines = !std::io::stderr().is_terminal();
        let bar = if lines {
            ProgressBar::hidden()
        } else {
            ProgressBar::new(u64::from(total))
        };
        if let Ok(style) =
            ProgressStyle::with_template("{msg} [{bar:40}] {pos}/{len} {per_sec}, {eta} left")
        {
            bar.set_style(style);
        }
        bar.set_message(name.to_owned());
        Progress {
            bar,
            lines,
            done: AtomicU32::new(0),
            total,
        }
    }

    fn step(&self) {
        self.bar.inc(1);
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        let step = self.total.div_ceil(20);
        if self.lines && (done.is_multiple_of(step) || done == self.total) {
            tell(format_args!("{done}/{} frames", self.total));
        }
    }
}
