//! `mluc-lab evaluate`: evaluates detections against labels.

mod ap;
mod compared;
mod model;
mod operating;
mod report;

use crate::commands::terminal::print_err;
use anyhow::ensure;
use clap::Subcommand;
use mluc_dataset::{Label, unseen_classes};
use mluc_evaluate::{ClassRule, unrecognized};
use std::collections::BTreeSet;

#[derive(Subcommand)]
pub(crate) enum What {
    Ap(ap::ApArguments),
    Operating(operating::OperatingArguments),
    Model(model::ModelArguments),
}

pub(crate) fn run(what: What) -> anyhow::Result<()> {
    match what {
        What::Ap(arguments) => ap::run(arguments),
        What::Operating(arguments) => operating::run(arguments),
        What::Model(arguments) => model::run(arguments),
    }
}

/// Warns of labels that no rule covers and whose class is not recognized: a detection of such an object counts as false.
fn warn_unrecognized<'a>(labels: impl Iterator<Item = &'a Label>, rules: &[ClassRule]) {
    for class in unrecognized(labels, rules) {
        print_err(format_args!(
            "warning: labels of class {class}, which is none of KITTI's nor of the simulator's; misspelt?"
        ));
    }
}

fn warn_unlabelled(option: &str, class: &str) {
    print_err(format_args!("warning: --{option} {class}: no label is of this class; misspelt?"));
}

/// The classes given with --unknown; `unseen` means the labelled ones of the simulator's unseen classes. A class without labels gives a warning;
/// if no class has labels, that is an error.
fn unknown_labelled<'a>(
    labels: impl Iterator<Item = &'a Label>,
    given: &[String],
) -> anyhow::Result<Vec<String>> {
    let labelled: BTreeSet<String> = labels.map(|l| l.class.to_ascii_lowercase()).collect();
    let mut unknown: Vec<String> = given.iter().map(|name| name.to_ascii_lowercase()).collect();
    if let Some(at) = unknown.iter().position(|name| name == "unseen") {
        let unseen = unseen_classes().map(str::to_ascii_lowercase);
        unknown.splice(at..=at, unseen.filter(|name| labelled.contains(name)));
    }
    let is_missing = |name: &&String| !labelled.contains(*name);
    let missing: Vec<&String> = unknown.iter().filter(is_missing).collect();
    ensure!(
        given.is_empty() || missing.len() < unknown.len(),
        "--unknown {}: expected classes of the labels ({}), found none of them",
        given.join(","),
        labelled.into_iter().collect::<Vec<_>>().join(", ")
    );
    for name in missing {
        warn_unlabelled("unknown", name);
    }
    Ok(unknown)
}
