//! `mluc-lab train`.

use std::io::IsTerminal;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::Context;
use clap::{Args, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use mluc_lab::train::{Event, Profile, Progress, Run, Setting, Settings};

/// Without a terminal, a line this often.
const LINE_EVERY: Duration = Duration::from_secs(30);

/// Train the network on a simulated or recorded data set and write its model file.
///
/// A run that was interrupted goes on from its last checkpoint when it is started again with the same settings.
#[derive(Args)]
pub(crate) struct Train {
    /// Classes and range.
    #[arg(long, value_enum)]
    setting: SettingName,
    /// Size of the network.
    #[arg(long, value_enum, default_value = "compact")]
    profile: ProfileName,
    /// Folder with train/ and val/ in KITTI's format (`mluc-lab simulate` makes them).
    #[arg(long)]
    data: PathBuf,
    /// Folder of the run: log, checkpoint, model.safetensors.
    #[arg(long)]
    out: PathBuf,
    /// Optimiser steps.
    #[arg(long, default_value_t = 20_000)]
    steps: u64,
    /// Frames a step.
    #[arg(long, default_value_t = 2)]
    batch: usize,
    /// Seed of weights, order and augmentation.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Highest learning rate of the cycle.
    #[arg(long, default_value_t = 0.003)]
    learning_rate: f64,
    /// T, the length of the prototypes; by default the number of classes (paper section 3.2).
    #[arg(long)]
    prototype_scale: Option<f32>,
    /// Weight of the loss that draws embeddings to their prototypes; the paper has none.
    #[arg(long, default_value_t = 0.0)]
    variance_weight: f32,
    /// Multiply in bf16 (sums, weights and weight gradients stay f32): faster where the processor has bf16.
    #[arg(long)]
    bf16: bool,
    /// Do not paste, mirror, turn or scale.
    #[arg(long)]
    no_augment: bool,
    /// Frames of the training split that give objects to paste.
    #[arg(long, default_value_t = 1500)]
    database_frames: usize,
    /// Frames of val/ that judge the model after every epoch and at the end; 0: none.
    #[arg(long, default_value_t = 400)]
    validate_frames: usize,
    /// Steps between checkpoints.
    #[arg(long, default_value_t = 200)]
    checkpoint_every: u64,
    /// Threads; 0: all cores.
    #[arg(long, default_value_t = 0)]
    threads: usize,
    /// Print where each step's time goes.
    #[arg(long)]
    profile_steps: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum SettingName {
    /// All around: car, pedestrian, cyclist, truck.
    Udi,
    /// To the front: car, pedestrian, cyclist.
    Kitti,
}

#[derive(Clone, Copy, ValueEnum)]
enum ProfileName {
    /// A tenth of the paper's network, for a few cores.
    Compact,
    /// The paper's network.
    Second,
}

impl Train {
    fn settings(&self) -> Settings {
        let setting = match self.setting {
            SettingName::Udi => Setting::Udi,
            SettingName::Kitti => Setting::Kitti,
        };
        let profile = match self.profile {
            ProfileName::Compact => Profile::Compact,
            ProfileName::Second => Profile::Second,
        };
        Settings {
            setting,
            profile,
            data: self.data.clone(),
            out: self.out.clone(),
            steps: self.steps,
            batch: self.batch,
            seed: self.seed,
            learning_rate: self.learning_rate,
            prototype_scale: self.prototype_scale.unwrap_or(setting.classes() as f32),
            variance_weight: self.variance_weight,
            bf16: self.bf16,
            augment: !self.no_augment,
            database_frames: self.database_frames,
            validate_frames: self.validate_frames,
            commit: commit().unwrap_or_else(|| "unknown".into()),
            checkpoint_every: self.checkpoint_every,
        }
    }
}

/// The commit that is checked out, where git and a repository are at hand.
fn commit() -> Option<String> {
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

/// Runs it.
pub(crate) fn run(arguments: Train) -> anyhow::Result<()> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(arguments.threads)
        .build_global()
        .context("the threads cannot be started")?;
    let mut screen = Screen::new(arguments.steps, arguments.profile_steps);
    let run = Run::prepare(&arguments.settings(), &mut |event| screen.show(event))?;
    let path = run.finish(&mut |event| screen.show(event))?;
    screen.bar.finish_and_clear();
    println!("{}", path.display());
    Ok(())
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
        let bar = if terminal {
            ProgressBar::new(steps)
        } else {
            ProgressBar::hidden()
        };
        if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} {msg}") {
            bar.set_style(style);
        }
        Screen {
            bar,
            terminal,
            every_line,
            last: None,
        }
    }

    fn show(&mut self, event: Event) {
        match event {
            Event::Note(text) if self.terminal => self.bar.println(text),
            Event::Note(text) => eprintln!("{text}"),
            Event::Progress(progress) => self.progress(progress),
        }
    }

    fn progress(&mut self, p: &Progress) {
        let l = &p.losses;
        let mut text = format!(
            "loss {:.3} (objectness {:.3}, metric {:.3}, variance {:.3}, box {:.3}, direction {:.3}), {:.2} frames/s, {:.0} min left",
            p.loss,
            l.objectness,
            l.metric,
            l.variance,
            l.boxes,
            l.direction,
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
            eprintln!("step {}/{}: {text}", p.step, p.steps);
            self.last = Some(Instant::now());
        }
    }
}
