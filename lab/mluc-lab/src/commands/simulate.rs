//! `mluc-lab simulate`: writes a simulated data set.

use super::terminal::{Progress, Threads, one_of, print_out};
use anyhow::Context;
use clap::Args;
use mluc_simulate::{ExportOptions, Realism, Step, export};

/// Write simulated, labelled scans as a KITTI-format folder.
///
/// DIR gets velodyne/, label_2/, calib/, planes/, instances/ and ImageSets/SPLIT.txt, for one split. Give each split a folder of its own, for example
/// data/sim-udi/train and data/sim-udi/val. The same family, split and seed give the same bytes, with any number of threads; a longer run begins with the
/// frames of a shorter one.
#[derive(Args)]
pub(crate) struct SimulateArguments {
    #[command(flatten)]
    options: ExportOptions,
    /// Leave out kinds of background, to measure what they are worth (comma separated): confusers (things of a car's size that are none), frontage,
    /// furniture, vegetation; of sim-any street and weather too. Not for training a model that is to be used.
    #[arg(long, value_parser = one_of(&Step::ALL, Step::name), hide_possible_values = true)]
    #[arg(value_delimiter = ',', value_name = "STEP,..")]
    without: Vec<Step>,
    #[command(flatten)]
    threads: Threads,
}

pub(crate) fn run(arguments: SimulateArguments) -> anyhow::Result<()> {
    arguments.threads.start()?;
    let mut options = arguments.options;
    options.realism = Realism::without(&arguments.without);
    let mut pair = options.clone();
    // Without a separator at its end.
    pair.folder = pair.folder.components().as_path().to_owned();
    pair.folder.as_mut_os_string().push("-pair");
    let has_pair = options.scanned_by.take().is_some();
    if has_pair {
        // Before hours are spent on the first.
        pair.check()?;
    }
    let name = export_with_progress(&options)?;
    if has_pair {
        export_with_progress(&pair)?;
    }
    let (realism, folder) = (options.realism, options.folder.display());
    let total = options.indices().len();
    print_out(format_args!("{name}{realism}: {total} frames in {folder}"))
}

/// Simulates, shows how far it is, and gives the name of what was simulated.
pub(super) fn export_with_progress(options: &ExportOptions) -> anyhow::Result<String> {
    let name = format!("{} {}", options.family.name(), options.split.name());
    let total = options.indices().len() as u64;
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
