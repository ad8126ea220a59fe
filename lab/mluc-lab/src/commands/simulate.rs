//! `mluc-lab simulate`: writes a simulated data set.

use super::terminal::{Threads, counted, print_out};
use anyhow::Context;
use clap::Args;
use mluc_simulate::{ExportOptions, Step, export};

/// Write simulated, labelled scans as a KITTI-format folder.
///
/// DIR gets velodyne/, label_2/, calib/, planes/, instances/ and ImageSets/SPLIT.txt, for one split. Give each split a folder of its own, for example
/// data/sim-udi/train and data/sim-udi/val. The same family, split and seed give the same bytes, with any number of threads; a longer run begins with the
/// frames of a shorter one.
#[derive(Args)]
pub(crate) struct SimulateArguments {
    #[command(flatten)]
    options: ExportOptions,
    #[command(flatten)]
    threads: Threads,
}

pub(crate) fn run(arguments: SimulateArguments) -> anyhow::Result<()> {
    arguments.threads.start()?;
    let mut options = arguments.options;
    let mut pair = options.clone();
    // Without a trailing separator.
    pair.folder = pair.folder.components().as_path().to_owned();
    pair.folder.as_mut_os_string().push("-pair");
    let has_pair = options.scanned_by.take().is_some();
    if has_pair {
        // Checked before the long simulation of the first data set.
        pair.check()?;
    }
    let name = export_with_progress(&options)?;
    if has_pair {
        export_with_progress(&pair)?;
    }
    let left_out = Step::ALL.into_iter().filter(|step| !options.has(*step));
    let left_out: Vec<&str> = left_out.map(Step::name).collect();
    let without = [" without ", ""][usize::from(left_out.is_empty())];
    let name = name + without + &left_out.join(", ");
    let (total, folder) = (options.indices().len(), options.folder.display());
    print_out(format_args!("{name}: {total} frames in {folder}"))
}

/// Simulates with a progress display, and returns the name of the data set.
pub(super) fn export_with_progress(options: &ExportOptions) -> anyhow::Result<String> {
    let name = format!("{} {}", options.family.name(), options.split.name());
    let done = counted(&name, options.indices().len(), |step| export(options, step));
    done.with_context(|| format!("simulating {name}"))?;
    Ok(name)
}
