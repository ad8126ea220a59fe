//! `mluc-lab audit`: what a benchmark folder holds.

use super::terminal::one_of;
use anyhow::Context;
use clap::Args;
use mluc_dataset::{Dataset, PrepareOptions, Splits, UnknownPolicy, prepare};
use mluc_evaluate::pipeline::unknown_classes;
use mluc_reproduce::audit;
use std::io::Write;
use std::path::PathBuf;

/// Print the object counts of KITTI's object benchmark, by class, split and difficulty, beside those that the paper quotes.
///
/// Every frame must have labels and a calibration, and every label must be of a class that KITTI has: anything else is an
/// error that names the file. With --prepare a split is written in the trainer's form: only what the camera sees, unknown
/// objects by --policy.
#[derive(Args)]
pub(crate) struct AuditArguments {
    /// Folder of the benchmark: training/ with velodyne, label_2 and calib (or training itself).
    #[arg(long, value_name = "DIR")]
    root: PathBuf,
    /// Folder with train.txt and val.txt [default: ImageSets in or beside --root].
    #[arg(long, value_name = "DIR")]
    splits: Option<PathBuf>,
    /// Count all frames as one split; no lists are needed.
    #[arg(long, conflicts_with = "splits")]
    all: bool,
    /// Write this split to --out.
    #[arg(long, value_name = "SPLIT", requires = "out", conflicts_with = "all")]
    prepare: Option<String>,
    /// What becomes of vans and trucks in the written split [default: they stay, labelled].
    #[arg(long, value_parser = one_of(&UnknownPolicy::ALL, UnknownPolicy::name), requires = "prepare")]
    policy: Option<UnknownPolicy>,
    /// Folder to write; must not exist.
    #[arg(long, value_name = "DIR", requires = "prepare")]
    out: Option<PathBuf>,
}

pub(crate) fn run(arguments: AuditArguments) -> anyhow::Result<()> {
    let splits = Splits {
        root: arguments.root,
        folder: arguments.splits,
    };
    let mut text = String::new();
    if let Some(split) = arguments.prepare {
        let expected = "--prepare: expected --out beside it, found none";
        let out = arguments.out.context(expected)?;
        let options = PrepareOptions {
            splits,
            split,
            policy: arguments.policy,
            unknown: unknown_classes("kitti"),
            out,
        };
        prepare(&options, || ())?;
        text = format!("{}\n", options.out.display());
    } else if arguments.all {
        let dataset = Dataset::open(&splits.frames_root())?;
        text = audit(&dataset, "all frames")?.to_markdown();
    } else {
        for split in ["train", "val"] {
            text += &audit(&splits.open(split)?, split)?.to_markdown();
            text.push('\n');
        }
    }
    Ok(std::io::stdout().write_all(text.as_bytes())?)
}
