//! `mluc-lab simulate`: writes a simulated data set.

use super::terminal::{Threads, bar, one_of, print_err, print_out};
use anyhow::Context;
use clap::Args;
use indicatif::ProgressBar;
use mluc_simulate::{ExportOptions, Family, Realism, Split, Step, export};
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
    #[command(flatten)]
    threads: Threads,
}

pub(crate) fn run(arguments: SimulateArguments) -> anyhow::Result<()> {
    let options = ExportOptions {
        family: arguments.family,
        split: arguments.split,
        frames: arguments.frames,
        sequence: arguments.sequence,
        seed: arguments.seed,
        realism: Realism::without(&arguments.without),
        synthetic_unknown: arguments.synthetic_unknown,
        folder: arguments.out,
        threads: arguments.threads.threads,
    };
    let name = format!("{} {}", options.family.name(), options.split.name());
    let progress = Progress::new(&name, options.frames);
    export(&options, || progress.step()).with_context(|| format!("simulating {name}"))?;
    progress.bar.finish_and_clear();
    print_out(format_args!(
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
        let style = "{msg} [{bar:40}] {pos}/{len} {per_sec}, {eta} left";
        Progress {
            bar: bar(name, u64::from(total), style),
            lines: !std::io::stderr().is_terminal(),
            done: AtomicU32::new(0),
            total,
        }
    }

    fn step(&self) {
        self.bar.inc(1);
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        let step = self.total.div_ceil(20);
        if self.lines && (done.is_multiple_of(step) || done == self.total) {
            print_err(format_args!("{done}/{} frames", self.total));
        }
    }
}
