//! Time of the trainer's step, by part: `train_step --setting kitti --data data/sim-kitti/val --frame 0 --threads 2`.
//!
//! Forward, then backward from a fixed random gradient of the outputs: neither losses nor the optimiser. The network is
//! the `compact` one that `mluc-lab train` trains, batch norm with the batch's statistics. `--every-cell` computes every
//! cell of the map, and every head there, as a framework of dense layers would; without it the halo and the heads of
//! labelled cells, as in training. Prints one JSON object. `--write DIR` leaves the step for `bench/peers/training`:
//! weights, gathers, gradients, and what came out.

mod work;
mod write;

use std::path::PathBuf;

use anyhow::Result;
use clap::Parser;
use mluc_bench::on_threads;
use mluc_train::layers::LayerPlan;
use mluc_train::{Architecture, NetworkKind, Setting, TrainSettings};
use serde_json::json;

use crate::work::Work;

/// Steps before the clock counts: memory is fetched by them.
const UNTIMED: usize = 2;

#[derive(Parser)]
struct Arguments {
    #[arg(long, value_parser = ["udi", "kitti"])]
    setting: String,
    /// Labelled scans in KITTI's layout.
    #[arg(long)]
    data: PathBuf,
    /// Numbers of the frames that make the batch.
    #[arg(long = "frame", num_args = 1.., default_values_t = [0])]
    frames: Vec<usize>,
    #[arg(long, default_value_t = 2)]
    threads: usize,
    /// Steps that are timed, after two that are not.
    #[arg(long, default_value_t = 5)]
    rounds: usize,
    /// As `mluc-lab train --bf16`.
    #[arg(long)]
    bf16: bool,
    /// No halo, and every head at every cell.
    #[arg(long)]
    every_cell: bool,
    /// Folder for the step's numbers.
    #[arg(long)]
    write: Option<PathBuf>,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    on_threads(arguments.threads, || run(&arguments))
}

fn run(arguments: &Arguments) -> Result<()> {
    let is_udi = arguments.setting == "udi";
    let setting = if is_udi { Setting::Udi } else { Setting::Kitti };
    // Nothing is trained: the folders of the settings are not looked at.
    let (data, out) = (PathBuf::new(), PathBuf::new());
    let (architecture, kind) = (Architecture::Compact, NetworkKind::Metric);
    let settings = TrainSettings::new(setting, architecture, kind, data, out);
    let mut work = Work::read(&settings, &arguments.data, &arguments.frames)?;
    if arguments.every_cell {
        work.compute_every_cell();
    }
    if arguments.bf16 {
        work.chain.use_bf16();
    }
    for _ in 0..UNTIMED {
        work.step();
    }
    let steps: Vec<_> = (0..arguments.rounds).map(|_| work.step()).collect();
    if let Some(folder) = &arguments.write {
        write::write(&mut work, folder)?;
    }
    let map = &work.plan.map;
    let rows = |plans: &[LayerPlan]| plans.last().map(|plan| plan.gather.outputs());
    let report = json!({
        "steps_ms": steps,
        "plan_ms": work.plan_ms,
        "voxels": work.plan.sparse.voxels.len() / 4,
        "cells": map.cells(),
        "rows_block1": rows(&map.block1),
        "rows_block2": rows(&map.block2),
        "labelled": work.labelled.len(),
        "parameters": work.chain.parameters,
    });
    println!("{report}");
    Ok(())
}
