//! The step that trains a network, as the command that a person would give: a run that was interrupted is resumed by the trainer
//! itself, and a fault in it cannot take the reproduction's state along.

use super::layout::Layout;
use super::{ReproduceError, Setting, Sizes};
use crate::dataset::read_text;
use mluc_model::Model;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A network and how it comes to be.
#[derive(Clone, Debug, PartialEq)]
pub struct Training {
    /// Kind of network: `metric`, `sigmoid`, `softmax`, `metric-open`, `improved`, `supervised`, `osis`.
    pub network: &'static str,
    /// Seed.
    pub seed: u64,
    /// Folder of the run.
    pub folder: PathBuf,
    /// Optimiser steps.
    pub steps: u64,
    /// Arguments of `mluc-lab`.
    pub arguments: Vec<String>,
}

/// The base network; the others begin with its weights.
pub(super) const BASE: &str = "metric";
/// Every kind of network, the base first; `osis` follows `softmax`, whose trunk it keeps.
pub(super) const NETWORKS: [&str; 7] = [
    BASE,
    "sigmoid",
    "softmax",
    "metric-open",
    "improved",
    "supervised",
    "osis",
];
/// Whether the trainer can make `osis`; where it cannot, the row is judged only if somebody else's model lies there.
pub(super) const OSIS_IS_TRAINED: bool = true;
/// Kinds that are trained with several seeds where that is asked for: naive, MLUC and improved stand on them.
pub(super) const SEEDED: [&str; 3] = [BASE, "softmax", "improved"];

/// Largest learning rate of the networks that begin with the base's weights: half of the base's, which they need not find again.
const TUNED_RATE: &str = "0.0015";

impl Training {
    pub(super) fn new(
        layout: &Layout,
        setting: Setting,
        sizes: &Sizes,
        network: &'static str,
        seed: u64,
    ) -> Training {
        let folder = layout.run_of(setting, network, seed);
        let is_base = network == BASE && seed == 1;
        let steps = match network {
            _ if is_base => sizes.base_steps,
            "sigmoid" | "metric-open" | "improved" | "supervised" => sizes.longer_steps,
            _ => sizes.tuned_steps,
        };
        // Recorded scans hold no made-up objects: there networks learn from pasted ones alone. Neither split has a `val` beside it.
        let is_simulated = setting.family().is_some();
        let (data, has_val) = match network {
            "supervised" => (layout.supervised_data_of(setting), false),
            "metric-open" | "improved" if is_simulated => (layout.made_up_data_of(setting), false),
            _ => (layout.data_of(setting), true),
        };
        let validate_frames = if has_val { sizes.validate_frames } else { 0 };
        let text = |path: &Path| path.display().to_string();
        let mut arguments: Vec<String> = [
            "train",
            "--setting",
            setting.trainer_name(),
            "--network",
            network,
        ]
        .map(str::to_owned)
        .into();
        arguments.extend([
            "--data".to_owned(),
            text(&data),
            "--out".to_owned(),
            text(&folder),
        ]);
        if !is_base {
            let from = if network == "osis" { "softmax" } else { BASE };
            let model = layout.model_of(setting, from, 1);
            arguments.extend(["--init".to_owned(), text(&model)]);
            arguments.extend(["--learning-rate", TUNED_RATE].map(str::to_owned));
        }
        let numbers = [
            ("--steps", steps),
            ("--batch", u64::from(sizes.batch)),
            ("--seed", seed),
            ("--validate-frames", u64::from(validate_frames)),
        ];
        arguments.extend(
            numbers
                .iter()
                .flat_map(|(name, n)| [(*name).to_owned(), n.to_string()]),
        );
        arguments.push("--bf16".to_owned());
        Training {
            network,
            seed,
            folder,
            steps,
            arguments,
        }
    }

    /// The command.
    pub fn command(&self) -> String {
        format!("mluc-lab {}", self.arguments.join(" "))
    }

    /// Runs the trainer to its end; its progress goes to this program's stderr.
    pub(super) fn run(&self, program: &Path) -> Result<(), ReproduceError> {
        // What makes the network, for the report: a model does not know how its run was started. A run that goes on may have been
        // begun by another command, and the trainer refuses it then.
        let path = self.folder.join(COMMAND_FILE);
        let write = || super::layout::write_whole(&path, self.command().as_bytes());
        if !self.folder.join("checkpoint.safetensors").exists() {
            write()?;
        }
        let status = Command::new(program)
            .args(&self.arguments)
            .stdout(std::process::Stdio::null())
            .status()
            .map_err(ReproduceError::io(program))?;
        if status.success() {
            return write();
        }
        Err(ReproduceError::Training {
            network: self.network.to_owned(),
            status: status.to_string(),
            command: self.command(),
        })
    }
}

/// In a run's folder: the command that made it, where a reproduction did.
const COMMAND_FILE: &str = "command.txt";

/// The command that made a run; "given" where it was not made by a reproduction.
pub(super) fn command_of(folder: &Path) -> String {
    std::fs::read_to_string(folder.join(COMMAND_FILE)).unwrap_or_else(|_| "given".to_owned())
}

/// How far a run of the trainer is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RunState {
    /// No model.
    Missing,
    /// The model has fewer steps than the run's own aim.
    Unfinished {
        /// Steps done.
        step: u64,
        /// Steps in all.
        steps: u64,
    },
    /// The run reached its own aim, or a model lies there without a log.
    Done,
}

/// The parts of the trainer's log that matter here.
#[derive(serde::Deserialize)]
struct LogLine {
    steps: u64,
}

/// Looks at a run's folder: the log's last line says how far the run was to go, the model how far it came.
pub fn run_state(folder: &Path) -> Result<RunState, ReproduceError> {
    let model = folder.join("model.safetensors");
    if !model.is_file() {
        return Ok(RunState::Missing);
    }
    let log = folder.join("train.jsonl");
    if !log.is_file() {
        return Ok(RunState::Done);
    }
    // A line that was cut by an interruption is passed over.
    let text = read_text(&log)?;
    let last = text
        .lines()
        .rev()
        .find_map(|line| serde_json::from_str::<LogLine>(line).ok());
    let step = Model::read(&model)?.manifest.provenance.steps;
    Ok(match last {
        Some(LogLine { steps }) if step >= steps => RunState::Done,
        Some(LogLine { steps }) => RunState::Unfinished { step, steps },
        None => RunState::Unfinished { step, steps: 0 },
    })
}
