//! Options and checks that the subcommands share.

use crate::commands::terminal::print_err;
use anyhow::ensure;
use clap::Args;
use mluc_dataset::Label;
use mluc_evaluate::{ClassRule, unheard};
use std::collections::BTreeSet;
use std::path::PathBuf;

/// A network and the scans that it is run on.
#[derive(Args)]
pub(super) struct Scans {
    /// Model file.
    #[arg(long, value_name = "FILE")]
    pub(super) model: PathBuf,
    /// Folder in KITTI's format: velodyne, label_2, calib.
    #[arg(long, value_name = "DIR")]
    pub(super) data: PathBuf,
    /// First so many frames.
    #[arg(long, default_value_t = usize::MAX, hide_default_value = true, value_name = "N")]
    pub(super) frames: usize,
}

impl Scans {
    pub(super) fn check(&self) -> anyhow::Result<()> {
        ensure!(self.frames > 0, "--frames: expected 1 or more, found 0");
        Ok(())
    }
}

/// Warns of labels that no rule judges and of a class that nobody has heard of: a detection of such an object counts as false.
pub(super) fn warn_unheard<'a>(labels: impl Iterator<Item = &'a Label>, rules: &[ClassRule]) {
    for class in unheard(labels, rules) {
        print_err(format_args!(
            "warning: labels of class {class}, which is none of KITTI's nor of the simulator's; misspelt?"
        ));
    }
}

/// Checks the names given with --unknown: one without labels is a warning, labels of none of them an error.
pub(super) fn check_unknown<'a>(
    labels: impl Iterator<Item = &'a Label>,
    unknown: &[String],
) -> anyhow::Result<()> {
    let labelled: BTreeSet<String> = labels.map(|l| l.class.to_ascii_lowercase()).collect();
    let is_missing = |name: &&String| !labelled.contains(&name.to_ascii_lowercase());
    let missing: Vec<&String> = unknown.iter().filter(is_missing).collect();
    ensure!(
        missing.is_empty() || missing.len() < unknown.len(),
        "--unknown {}: expected classes of the labels ({}), found none of them",
        unknown.join(","),
        labelled.into_iter().collect::<Vec<_>>().join(", ")
    );
    for name in missing {
        print_err(format_args!(
            "warning: --unknown {name}: no label is of this class; misspelt?"
        ));
    }
    Ok(())
}
