//! The step that trains a network with the same command that a person would use: the trainer itself resumes an interrupted run,
//! and a crash of the trainer does not affect the reproduction.

use crate::{Layout, Result, Setting, layout::write_whole, setting::Sizes};
use mluc_dataset::read_text;
use mluc_evaluate::EvaluateError;
use mluc_model::Model;
use mluc_train::{NetworkKind, TrainSettings};
use serde::Deserialize;
use serde_json::Value;
use std::{path::Path, path::PathBuf, process::Command, process::Stdio, sync::LazyLock};

pub(crate) struct Training {
    pub(crate) network: NetworkKind,
    pub(crate) seed: u64,
    pub(crate) folder: PathBuf,
    pub(crate) steps: u64,
    pub(crate) arguments: Vec<String>,
}

/// A kind of network and its training, as in `networks.json`.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(crate) struct NetworkPlan {
    pub(crate) network: NetworkKind,
    /// The network whose weights it starts from; the first network of the base, `metric`, starts from none.
    init: NetworkKind,
    /// Whether it uses [`Sizes::longer_steps`].
    longer: bool,
    /// Suffix of its own data, see [`Layout::data_of`]; these have no `val`.
    data: String,
    /// Whether it is trained with several seeds on request: naive, MLUC and our method run on such networks.
    pub(crate) seeded: bool,
    /// Whether its boxes have scores that separate unknown from known.
    pub(crate) scored: bool,
}

/// Every kind of network, each after the network that it starts from.
pub(crate) static NETWORKS: LazyLock<Vec<NetworkPlan>> =
    LazyLock::new(|| serde_json::from_str(include_str!("networks.json")).expect("the table"));

/// The base network; the others start from its weights.
pub(crate) const BASE: NetworkKind = NetworkKind::Metric;
/// Largest learning rate of the networks that start from another's weights: half of the base's, since the weights are already good.
const TUNED_RATE: &str = "0.0015";

impl Training {
    pub(crate) fn new(
        layout: &Layout,
        setting: Setting,
        sizes: &Sizes,
        plan: &NetworkPlan,
        seed: u64,
    ) -> Training {
        let network = plan.network;
        let folder = layout.run_of((setting, network, seed));
        let is_base = network == BASE && seed == 1;
        let steps = if is_base {
            sizes.base_steps
        } else if plan.longer {
            sizes.longer_steps
        } else {
            sizes.tuned_steps
        };
        // Recorded scans have no synthetic unknown objects: networks then learn only from pasted ones.
        let is_recorded = setting.family().is_none();
        let data = match plan.data.as_str() {
            "-synthetic-unknown" if is_recorded => "",
            data => data,
        };
        let is_own = data.is_empty();
        let validate_frames = if is_own { sizes.validate_frames } else { 0 };
        let mut arguments = vec!["train".to_owned()];
        let mut add = |name: &str, value: String| arguments.extend([name.to_owned(), value]);
        // A folder's name may start like an option.
        let dot = |path: &Path| ["", "./"][usize::from(path.to_string_lossy().starts_with('-'))];
        let text = |path: &Path| format!("{}{}", dot(path), path.display());
        add("--setting", setting.trainer_name().to_owned());
        add("--network", network.name());
        add("--data", text(&layout.data_of(setting, data)));
        add("--out", text(&folder));
        if !is_base {
            add("--init", text(&layout.model_of((setting, plan.init, 1))));
            add("--learning-rate", TUNED_RATE.to_owned());
        }
        add("--steps", steps.to_string());
        add("--batch", sizes.batch.to_string());
        add("--seed", seed.to_string());
        add("--validate-frames", validate_frames.to_string());
        // A resumed run keeps its choice of bf16, on any processor.
        let begun = command_of(&folder);
        let is_new = begun == "given";
        if begun.ends_with("--bf16") || (is_new && TrainSettings::bf16_is_faster()) {
            arguments.push("--bf16".to_owned());
        }
        Training { network, seed, folder, steps, arguments }
    }

    pub(crate) fn command(&self) -> String {
        format!("mluc-lab {}", self.arguments.join(" "))
    }

    /// Runs the trainer to its end; its progress goes to this program's stderr.
    pub(crate) fn run(&self, program: &Path) -> Result<()> {
        // Stores the command for the report: a model does not contain it. A resumed run may have another initial command; the trainer then
        // rejects the run.
        let path = self.folder.join(COMMAND_FILE);
        let write = || write_whole(&path, self.command().as_bytes());
        if !self.folder.join("checkpoint.safetensors").exists() {
            write()?;
        }
        let status = Command::new(program)
            .args(&self.arguments)
            .args(["--threads", &rayon::current_num_threads().to_string()])
            .stdout(Stdio::null())
            .status()
            .map_err(|e| EvaluateError::file(program, e))?;
        if status.success() {
            return write();
        }
        Err(EvaluateError::Input(format!(
            "training {}: expected exit status 0, found {status}; the command was: {}",
            self.network.name(),
            self.command()
        )))
    }
}

/// File in a run's folder with the command that made it, where a reproduction did.
const COMMAND_FILE: &str = "command.txt";

/// The command that made a run; "given" where it was not made by a reproduction.
pub(crate) fn command_of(folder: &Path) -> String {
    std::fs::read_to_string(folder.join(COMMAND_FILE)).unwrap_or_else(|_| "given".to_owned())
}

/// Progress of a run of the trainer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RunState {
    /// No model.
    Missing,
    /// The model has fewer steps than the run's target.
    Unfinished {
        /// Steps done.
        step: u64,
        /// Total number of steps.
        steps: u64,
    },
    /// The run reached its target, or there is a model without a log.
    Done,
}

/// Reads a run's folder: the last line of the log gives the target of the run, the model the steps done.
pub fn run_state(folder: &Path) -> Result<RunState> {
    let (model, log) = (folder.join("model.safetensors"), folder.join("train.jsonl"));
    if !model.is_file() {
        return Ok(RunState::Missing);
    }
    if !log.is_file() {
        return Ok(RunState::Done);
    }
    // A line that an interruption truncated is skipped.
    let text = read_text(&log)?;
    let steps_of = |line| serde_json::from_str::<Value>(line).ok()?["steps"].as_u64();
    let steps = text.lines().rev().find_map(steps_of);
    let step = Model::read(&model)?.manifest.provenance.steps;
    Ok(match steps {
        Some(steps) if step >= steps => RunState::Done,
        _ => RunState::Unfinished { step, steps: steps.unwrap_or(0) },
    })
}
