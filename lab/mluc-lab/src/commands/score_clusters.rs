//! `mluc-lab score-clusters`: adds a cluster scorer to a model.

use super::terminal::{Threads, counted, write_out};
use anyhow::{Context, ensure};
use clap::Args;
use mluc_evaluate::pipeline::FrameSet;
use mluc_model::{HeadKind, Model, model_bytes};
use mluc_train::cluster_scorer::fit_to_proposals;
use std::path::PathBuf;

/// Fit the layers by which the refiner scores clusters, on training scans with synthetic unknown objects, and store them in a model file.
///
/// For a network with an output for the unknown (mluc-full): the layers learn to separate what it proposes on synthetic unknown objects from what it
/// proposes elsewhere. Its other weights stay as they are. Profiles, probabilities and figures of the old score are removed: choose and
/// measure them anew (evaluate model --refiner range-scaled --write-profiles --write-precisions).
#[derive(Args)]
pub(crate) struct ScoreClustersArguments {
    /// Model file.
    #[arg(long, value_name = "FILE")]
    model: PathBuf,
    /// Training scans with labels: `simulate --split train --synthetic-unknown`, best of a seed that the network was not trained on.
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// Where the model goes with the layers; may be the same file.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    #[command(flatten)]
    threads: Threads,
}

pub(crate) fn run(arguments: ScoreClustersArguments) -> anyhow::Result<()> {
    arguments.threads.start()?;
    let mut model = Model::read(&arguments.model)?;
    let head = model.manifest.network.head;
    ensure!(
        head == HeadKind::Open,
        "{}: expected a network with an output for the unknown (mluc-full), found a {head:?} head",
        arguments.model.display()
    );
    let set = FrameSet::open(&arguments.data, None, usize::MAX)?;
    let scorer =
        counted("network", set.names().len(), |step| fit_to_proposals(&model, &set, 1, step))?;
    let scorer = scorer.with_context(|| {
        let data = set.describe();
        format!("{data}: expected boxes of the network on synthetic unknown objects (simulate --synthetic-unknown) and boxes elsewhere, found only one of the two kinds, or none")
    })?;
    scorer.write(&mut model.weights);
    let own = &mut model.manifest;
    (own.thresholds.profiles, own.thresholds.probabilities) = (None, None);
    own.provenance.profile_choice.clear();
    own.provenance.metrics.retain(|name, _| !name.starts_with("ap_unknown"));
    let bytes = model_bytes(&model.manifest, &model.weights)?;
    write_out(&arguments.out, &bytes)
}
