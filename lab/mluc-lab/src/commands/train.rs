//! `mluc-lab train`.

use super::terminal::{Progress, Threads, print_err, print_out};
use clap::Args;
use mluc_train::{NetworkKind, Progress as TrainProgress};
use mluc_train::{Run, TrainEvent, TrainSettings, train_osis};
use std::path::PathBuf;

/// Train the network on a simulated or recorded data set and write its model file.
///
/// A run that was interrupted continues from its last checkpoint when it is started again with the same settings.
#[derive(Args)]
pub(crate) struct Train {
    #[command(flatten)]
    settings: TrainSettings,
    #[command(flatten)]
    threads: Threads,
    /// Write the first weights to the run's folder and the batches to standard output, for tools/train_on_gpu, and train nothing here.
    #[arg(long)]
    stream: bool,
}

/// The last commit before this program was built, in the checkout that it was built in; `unknown` where git or a repository is not available.
pub(super) fn commit() -> String {
    let built = std::env::current_exe().and_then(|program| program.metadata()?.modified());
    let built = built.ok().and_then(|at| at.duration_since(std::time::UNIX_EPOCH).ok());
    let before = format!("--before={}", built.unwrap_or_default().as_secs());
    let mut git = std::process::Command::new("git");
    git.args(["-C", env!("CARGO_MANIFEST_DIR"), "log", "-1", "--abbrev=12", "--format=%h"]);
    let output = git.arg(before).output();
    let output = output.ok().filter(|output| output.status.success());
    let text = output.and_then(|output| String::from_utf8(output.stdout).ok());
    let commit = text.map(|text| text.trim().to_owned()).filter(|text| !text.is_empty());
    commit.unwrap_or_else(|| "unknown".into())
}

/// Options of glibc's allocator: large blocks come from the heap and stay there. By default every block above at most 32 MiB is mapped
/// anew, and each of its pages costs a fault at the first write: a fifth to a third of a step.
const MEMORY: [(&str, &str); 3] = [
    ("MALLOC_MMAP_MAX_", "0"),
    ("MALLOC_TRIM_THRESHOLD_", "1000000000000"),
    ("MALLOC_TOP_PAD_", "268435456"),
];

/// Restarts this program with [`MEMORY`], which the allocator reads only at the start. If one of these variables is already set, nothing
/// is changed; other allocators ignore them.
pub(super) fn tune_memory() {
    let is_set = |(name, _): &(&str, &str)| std::env::var_os(name).is_some();
    if MEMORY.iter().any(is_set) {
        return;
    }
    let Ok(program) = std::env::current_exe() else {
        return;
    };
    let mut command = std::process::Command::new(program);
    command.args(std::env::args_os().skip(1)).envs(MEMORY);
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        // `exec` returns only on failure; the run then continues without these options.
        let fault = std::os::unix::process::CommandExt::exec(&mut command);
        print_err(format_args!("the allocator keeps its defaults: {fault}"));
    }
}

pub(crate) fn run(arguments: Train) -> anyhow::Result<()> {
    tune_memory();
    arguments.threads.start()?;
    let mut settings = arguments.settings;
    settings.commit = commit();
    if arguments.stream {
        let is_osis = settings.kind == NetworkKind::Osis;
        anyhow::ensure!(!is_osis, "--stream: osis trains points, not a network");
        let note = |event: TrainEvent| match event {
            TrainEvent::Note(text) => print_err(text),
            TrainEvent::Progress(_) => (),
        };
        return Ok(Run::prepare(&settings, &mut { note })?.stream(&mut std::io::stdout().lock())?);
    }
    print_out(train(&settings)?.display())
}

/// Trains with a progress display; returns the path of the model file.
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
    let parts: Vec<String> = used.map(|(name, value)| format!("{name} {value:.3}")).collect();
    let text = format!(
        "loss {:.3} ({}), {:.2} frames/s, {:.0} min left",
        p.loss,
        parts.join(", "),
        p.frames_per_s,
        p.left_s / 60.0
    );
    let line = format!("step {}/{}: {text}", p.step, p.steps);
    screen.line(p.step == p.steps, line);
    screen.bar.set_position(p.step);
    screen.bar.set_message(text);
}
