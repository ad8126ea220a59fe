//! `mluc-lab stats`: what a data set holds.

use super::terminal::print_out;
use clap::Args;
use mluc_dataset::Dataset;
use mluc_simulate::statistics::{collect, read_reference, table};
use std::path::PathBuf;

/// Print sizes, distances and points of a data set's objects, class by class, as Markdown tables.
#[derive(Args)]
pub(crate) struct StatsArguments {
    /// KITTI-format folder with velodyne/, label_2/ and calib/.
    #[arg(long)]
    dataset: PathBuf,
    /// Published figures to print beside (JSON with train_split_3712.classes).
    #[arg(long)]
    reference: Option<PathBuf>,
}

pub(crate) fn run(arguments: StatsArguments) -> anyhow::Result<()> {
    let reference = arguments.reference.as_deref().map(read_reference);
    let reference = reference.transpose()?;
    let statistics = collect(&Dataset::open(&arguments.dataset)?)?;
    print_out(table(&statistics, reference.as_ref()).trim_end())
}
