//! `mluc-lab train`.

use super::terminal::{Threads, bar, print_err, print_out};
use std::io::IsTerminal;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::Context;
use clap::Args;
use indicatif::ProgressBar;
use mluc_train::{
    Architecture, NetworkKind, OpenSetSettings, Progress, Run, Setting, TrainEvent, TrainSettings,
    train_osis,
};
use serde::Deserialize;

/// Without a terminal, a line this often.
const LINE_EVERY: Duration = Duration::from_secs(30);

/// Train the network on a simulated or recorded data set and write its model file.
///
/// A run that was interrupted goes on from its last checkpoint when it is started again with the same settings.
#[derive(Args)]
pub(crate) struct Train {
    /// Settings from a TOML file, named as the options with `_` for `-`; the command line wins.
    #[arg(long)]
    config: Option<PathBuf>,
    #[command(flatten)]
    choices: Choices,
    #[command(flatten)]
    threads: Threads,
    /// Print where each step's time goes.
    #[arg(long)]
    profile_steps: bool,
}

/// What may be set on the command line and in a file.
#[derive(Args, Clone, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Choices {
    /// Classes and range.
    #[arg(long, value_enum)]
    setting: Option<Setting>,
    /// Size of the network [default: compact].
    #[arg(long, value_enum)]
    architecture: Option<Architecture>,
    /// What its heads learn [default: metric].
    #[arg(long, value_enum)]
    network: Option<NetworkKind>,
    /// Folder with train/ and val/ in KITTI's format (`mluc-lab simulate` makes them); all scans in them are taken, lists in ImageSets are not read.
    #[arg(long)]
    data: Option<PathBuf>,
    /// Folder of the run: log, checkpoint, model.safetensors.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Start from the weights of this model file (or run's folder) where they fit.
    #[arg(long)]
    init: Option<PathBuf>,
    /// Optimiser steps [default: 20000].
    #[arg(long)]
    steps: Option<u64>,
    /// Frames a step [default: 2].
    #[arg(long)]
    batch: Option<usize>,
    /// Seed of weights, order and augmentation [default: 1].
    #[arg(long)]
    seed: Option<u64>,
    /// Highest learning rate of the cycle [default: 0.003].
    #[arg(long)]
    learning_rate: Option<f64>,
    /// T, the length of the prototypes [default: the number of classes (paper section 3.2); 3 for mluc-full].
    #[arg(long)]
    prototype_scale: Option<f32>,
    /// Weight of the loss that draws embeddings to their prototypes [default: 0, the paper has none; 0.1 for metric-open and mluc-full].
    #[arg(long)]
    variance_weight: Option<f32>,
    /// Metric-open, mluc-full: synthetic unknown objects pasted into a frame, beside those that the data holds (simulate --synthetic-unknown) [default: 6].
    #[arg(long)]
    synthetic_unknown: Option<usize>,
    /// Metric-open, mluc-full: weight of the loss that draws their embeddings to the centre; of metric-open also background's away from
    /// it [default: 0.5].
    #[arg(long)]
    center_loss_weight: Option<f32>,
    /// Mluc-full: weight of the logit of the unknown [default: 1].
    #[arg(long)]
    unknown_weight: Option<f32>,
    /// Metric-open, mluc-full: cells of a frame with points and no object that are learned from [default: 512, 64].
    #[arg(long)]
    background_cells: Option<usize>,
    /// Mluc-full: no class-agnostic anchors.
    #[arg(long)]
    no_class_agnostic_anchors: bool,
    /// Mluc-full: fit the layers that score clusters [default: true for udi, false for kitti].
    #[arg(long, value_name = "BOOL")]
    cluster_scorer: Option<bool>,
    /// Multiply the gradients of layers' inputs in bf16 (all else stays f32): faster where the processor has bf16.
    #[arg(long)]
    bf16: bool,
    /// Do not paste, mirror, turn or scale.
    #[arg(long)]
    no_augment: bool,
    /// Frames of the training split that give objects to paste [default: 1500].
    #[arg(long)]
    database_frames: Option<usize>,
    /// Frames of val/ that judge the model after every epoch and at the end [default: 400]; 0: none.
    #[arg(long)]
    validate_frames: Option<usize>,
    /// Classes of labels that the network does not know, beside KITTI's and the simulator's: their place teaches nothing. Any other class is
    /// an error: misspelt, its objects would be left out without a word.
    #[arg(long, value_delimiter = ',', value_name = "CLASS,..")]
    ignore_classes: Vec<String>,
    /// Steps between checkpoints [default: 200].
    #[arg(long)]
    checkpoint_every: Option<u64>,
}

impl Choices {
    /// These, and where they say nothing those of `base`.
    fn or(self, base: Choices) -> Choices {
        Choices {
            setting: self.setting.or(base.setting),
            architecture: self.architecture.or(base.architecture),
            network: self.network.or(base.network),
            data: self.data.or(base.data),
            out: self.out.or(base.out),
            init: self.init.or(base.init),
            steps: self.steps.or(base.steps),
            batch: self.batch.or(base.batch),
            seed: self.seed.or(base.seed),
            learning_rate: self.learning_rate.or(base.learning_rate),
            prototype_scale: self.prototype_scale.or(base.prototype_scale),
            variance_weight: self.variance_weight.or(base.variance_weight),
            synthetic_unknown: self.synthetic_unknown.or(base.synthetic_unknown),
            center_loss_weight: self.center_loss_weight.or(base.center_loss_weight),
            unknown_weight: self.unknown_weight.or(base.unknown_weight),
            background_cells: self.background_cells.or(base.background_cells),
            no_class_agnostic_anchors: self.no_class_agnostic_anchors
                || base.no_class_agnostic_anchors,
            cluster_scorer: self.cluster_scorer.or(base.cluster_scorer),
            bf16: self.bf16 || base.bf16,
            no_augment: self.no_augment || base.no_augment,
            database_frames: self.database_frames.or(base.database_frames),
            validate_frames: self.validate_frames.or(base.validate_frames),
            ignore_classes: if self.ignore_classes.is_empty() {
                base.ignore_classes
            } else {
                self.ignore_classes
            },
            checkpoint_every: self.checkpoint_every.or(base.checkpoint_every),
        }
    }

    fn settings(self) -> anyhow::Result<TrainSettings> {
        let setting = self.setting.context("--setting is missing: udi or kitti")?;
        let architecture = self.architecture.unwrap_or(Architecture::Compact);
        let kind = self.network.unwrap_or_default();
        let data = self
            .data
            .context("--data is missing: the folder with train/ and val/")?;
        let out = self
            .out
            .context("--out is missing: the folder of the run")?;
        let default = TrainSettings::new(setting, architecture, kind, data, out);
        let open_set = OpenSetSettings {
            synthetic_unknown: self
                .synthetic_unknown
                .unwrap_or(default.open_set.synthetic_unknown),
            center_loss_weight: self
                .center_loss_weight
                .unwrap_or(default.open_set.center_loss_weight),
            unknown_weight: self
                .unknown_weight
                .unwrap_or(default.open_set.unknown_weight),
            class_agnostic_anchors: !self.no_class_agnostic_anchors,
            background_cells: self
                .background_cells
                .unwrap_or(default.open_set.background_cells),
        };
        Ok(TrainSettings {
            init: self.init,
            open_set,
            cluster_scorer: self.cluster_scorer.unwrap_or(default.cluster_scorer)
                && kind == NetworkKind::MlucFull,
            steps: self.steps.unwrap_or(default.steps),
            batch: self.batch.unwrap_or(default.batch),
            seed: self.seed.unwrap_or(default.seed),
            learning_rate: self.learning_rate.unwrap_or(default.learning_rate),
            prototype_scale: self.prototype_scale.unwrap_or(default.prototype_scale),
            variance_weight: self.variance_weight.unwrap_or(default.variance_weight),
            bf16: self.bf16,
            augment: !self.no_augment,
            database_frames: self.database_frames.unwrap_or(default.database_frames),
            validate_frames: self.validate_frames.unwrap_or(default.validate_frames),
            ignored_classes: self.ignore_classes,
            commit: commit().unwrap_or_else(|| "unknown".into()),
            checkpoint_every: self.checkpoint_every.unwrap_or(default.checkpoint_every),
            ..default
        })
    }
}

impl Train {
    fn settings(&self) -> anyhow::Result<TrainSettings> {
        let file = match &self.config {
            None => Choices::default(),
            Some(path) => {
                let text = std::fs::read_to_string(path)
                    .with_context(|| format!("{} cannot be read", path.display()))?;
                toml::from_str(&text).with_context(|| path.display().to_string())?
            }
        };
        self.choices.clone().or(file).settings()
    }
}

/// The commit that is checked out, where git and a repository are at hand.
pub(super) fn commit() -> Option<String> {
    let output = std::process::Command::new("git")
        .args(["rev-parse", "--short=12", "HEAD"])
        .output()
        .ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output
        .status
        .success()
        .then(|| text.trim().to_owned())
        .filter(|text| !text.is_empty())
}

/// What glibc's allocator is told: large blocks come from the heap and stay there. By default every block above 32 MiB at most is
/// mapped afresh, and each of its pages costs a fault when it is first written: a fifth to a third of a step.
const MEMORY: [(&str, &str); 3] = [
    ("MALLOC_MMAP_MAX_", "0"),
    ("MALLOC_TRIM_THRESHOLD_", "1000000000000"),
    ("MALLOC_TOP_PAD_", "268435456"),
];

/// Starts this program anew with [`MEMORY`], which the allocator reads at the start alone. Whoever sets one of them is left alone;
/// another allocator does not look at them.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
fn tune_memory() {
    use std::os::unix::process::CommandExt;
    if MEMORY
        .iter()
        .any(|(name, _)| std::env::var_os(name).is_some())
    {
        return;
    }
    let Ok(program) = std::env::current_exe() else {
        return;
    };
    // It comes back only where it failed; the run then goes on as it is.
    let fault = std::process::Command::new(program)
        .args(std::env::args_os().skip(1))
        .envs(MEMORY)
        .exec();
    print_err(format_args!("the allocator keeps its defaults: {fault}"));
}

/// Runs it.
pub(crate) fn run(arguments: Train) -> anyhow::Result<()> {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    tune_memory();
    arguments.threads.start()?;
    let settings = arguments.settings()?;
    let mut screen = Screen::new(settings.steps, arguments.profile_steps);
    let mut tell = |event: TrainEvent| screen.show(event);
    let path = match settings.kind {
        NetworkKind::Osis => train_osis(&settings, &mut tell)?,
        _ => Run::prepare(&settings, &mut tell)?.finish(&mut tell)?,
    };
    screen.bar.finish_and_clear();
    print_out(path.display())
}

/// A bar on a terminal, lines elsewhere; always on stderr.
struct Screen {
    bar: ProgressBar,
    terminal: bool,
    every_line: bool,
    last: Option<Instant>,
}

impl Screen {
    fn new(steps: u64, every_line: bool) -> Screen {
        let terminal = std::io::stderr().is_terminal();
        Screen {
            bar: bar("", steps, "{bar:30} {pos}/{len} {msg}"),
            terminal,
            every_line,
            last: None,
        }
    }

    fn show(&mut self, event: TrainEvent) {
        match event {
            TrainEvent::Note(text) if self.terminal => self.bar.println(text),
            TrainEvent::Note(text) => print_err(text),
            TrainEvent::Progress(progress) => self.progress(progress),
        }
    }

    fn progress(&mut self, p: &Progress) {
        let mut losses = p.losses;
        let named = losses.named_mut();
        let used = named.iter().filter(|(_, value)| **value != 0.0);
        let parts: Vec<String> = used
            .map(|(name, value)| format!("{name} {value:.3}"))
            .collect();
        let mut text = format!(
            "loss {:.3} ({}), {:.2} frames/s, {:.0} min left",
            p.loss,
            parts.join(", "),
            p.frames_per_s,
            p.left_s / 60.0
        );
        if self.every_line {
            let t = &p.timing_ms;
            text += &format!(
                "; ms: wait {:.0}, prepare {:.0}, forward {:.0}, losses {:.0}, backward {:.0}, update {:.0}",
                t.wait, t.prepare, t.forward, t.losses, t.backward, t.update
            );
        }
        self.bar.set_position(p.step);
        self.bar.set_message(text.clone());
        let due = self.last.is_none_or(|last| last.elapsed() >= LINE_EVERY);
        if !self.terminal && (due || self.every_line || p.step == p.steps) {
            print_err(format_args!("step {}/{}: {text}", p.step, p.steps));
            self.last = Some(Instant::now());
        }
    }
}
