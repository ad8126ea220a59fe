//! `mluc-lab train`.

use super::terminal::{Progress, Threads, print_err, print_out};
use std::path::PathBuf;

use anyhow::Context;
use clap::Args;
use mluc_train::{
    Architecture, NetworkKind, Progress as TrainProgress, Run, Setting, TrainEvent, TrainSettings,
    train_osis,
};

/// Train the network on a simulated or recorded data set and write its model file.
///
/// A run that was interrupted goes on from its last checkpoint when it is started again with the same settings.
#[derive(Args)]
pub(crate) struct Train {
    #[command(flatten)]
    choices: Choices,
    #[command(flatten)]
    threads: Threads,
}

/// What may be set.
#[derive(Args)]
struct Choices {
    /// Classes and range.
    #[arg(long, value_enum)]
    setting: Option<Setting>,
    /// Classes to learn, of those that the labels name [default: the setting's].
    #[arg(long, value_delimiter = ',', value_name = "CLASS,..")]
    known: Vec<String>,
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
    /// Metric-open, mluc-full: synthetic unknown objects pasted into a frame, beside those that the data holds (simulate --synthetic-unknown) [default: 6; none for any].
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
    /// Frames of the training split that give objects to paste [default: 1500; none for any].
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
    fn settings(self) -> anyhow::Result<TrainSettings> {
        fn set<T>(place: &mut T, given: Option<T>) {
            if let Some(value) = given {
                *place = value;
            }
        }
        let setting = self
            .setting
            .context("--setting is missing: udi, kitti or any")?;
        let architecture = self.architecture.unwrap_or(Architecture::Compact);
        let kind = self.network.unwrap_or_default();
        let data = self
            .data
            .context("--data is missing: the folder with train/ and val/")?;
        let out = self
            .out
            .context("--out is missing: the folder of the run")?;
        let mut all = TrainSettings::new(setting, architecture, kind, data, out);
        let open_set = &mut all.open_set;
        set(&mut open_set.synthetic_unknown, self.synthetic_unknown);
        set(&mut open_set.center_loss_weight, self.center_loss_weight);
        set(&mut open_set.unknown_weight, self.unknown_weight);
        set(&mut open_set.background_cells, self.background_cells);
        open_set.class_agnostic_anchors = !self.no_class_agnostic_anchors;
        set(&mut all.cluster_scorer, self.cluster_scorer);
        all.cluster_scorer &= kind == NetworkKind::MlucFull;
        set(&mut all.steps, self.steps);
        set(&mut all.batch, self.batch);
        set(&mut all.seed, self.seed);
        set(&mut all.learning_rate, self.learning_rate);
        set(&mut all.prototype_scale, self.prototype_scale);
        set(&mut all.variance_weight, self.variance_weight);
        set(&mut all.database_frames, self.database_frames);
        set(&mut all.validate_frames, self.validate_frames);
        set(&mut all.checkpoint_every, self.checkpoint_every);
        Ok(TrainSettings {
            init: self.init,
            known: self
                .known
                .iter()
                .map(|name| name.to_ascii_lowercase())
                .collect(),
            bf16: self.bf16,
            augment: !self.no_augment,
            ignored_classes: self.ignore_classes,
            commit: commit(),
            ..all
        })
    }
}

/// The commit that is checked out; `unknown` where git or a repository is not at hand.
pub(super) fn commit() -> String {
    let mut git = std::process::Command::new("git");
    let output = git.args(["rev-parse", "--short=12", "HEAD"]).output();
    let output = output.ok().filter(|output| output.status.success());
    let text = output.and_then(|output| String::from_utf8(output.stdout).ok());
    let commit = text
        .map(|text| text.trim().to_owned())
        .filter(|text| !text.is_empty());
    commit.unwrap_or_else(|| "unknown".into())
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
pub(super) fn tune_memory() {
    if MEMORY
        .iter()
        .any(|(name, _)| std::env::var_os(name).is_some())
    {
        return;
    }
    let Ok(program) = std::env::current_exe() else {
        return;
    };
    let mut command = std::process::Command::new(program);
    command.args(std::env::args_os().skip(1)).envs(MEMORY);
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        // It comes back only where it failed; the run then goes on as it is.
        let fault = std::os::unix::process::CommandExt::exec(&mut command);
        print_err(format_args!("the allocator keeps its defaults: {fault}"));
    }
}

pub(crate) fn run(arguments: Train) -> anyhow::Result<()> {
    tune_memory();
    arguments.threads.start()?;
    let path = train(&arguments.choices.settings()?)?;
    print_out(path.display())
}

/// Trains and shows how far it is; gives the model file.
pub(super) fn train(settings: &TrainSettings) -> anyhow::Result<PathBuf> {
    let screen = Progress::new("", settings.steps, "{bar:30} {pos}/{len} {msg}");
    let mut tell = |event: TrainEvent| match event {
        TrainEvent::Note(text) => screen.note(&text),
        TrainEvent::Progress(progress) => show(&screen, progress),
    };
    let path = match settings.kind {
        NetworkKind::Osis => train_osis(settings, &mut tell)?,
        _ => Run::prepare(settings, &mut tell)?.finish(&mut tell)?,
    };
    screen.bar.finish_and_clear();
    Ok(path)
}

fn show(screen: &Progress, p: &TrainProgress) {
    let mut losses = p.losses;
    let named = losses.named_mut();
    let used = named.iter().filter(|(_, value)| **value != 0.0);
    let parts: Vec<String> = used
        .map(|(name, value)| format!("{name} {value:.3}"))
        .collect();
    let text = format!(
        "loss {:.3} ({}), {:.2} frames/s, {:.0} min left",
        p.loss,
        parts.join(", "),
        p.frames_per_s,
        p.left_s / 60.0
    );
    screen.line(
        p.step == p.steps,
        format_args!("step {}/{}: {text}", p.step, p.steps),
    );
    screen.bar.set_position(p.step);
    screen.bar.set_message(text);
}
