//! `mluc-lab reproduce`: the paper's tables with one command.

use super::{terminal::Progress, terminal::Threads, terminal::print_out, train::commit};
use anyhow::Context;
use clap::Args;
use mluc_reproduce::{Options, Screen, run};

/// Simulate, train and evaluate what is missing, and write the report: the paper's tables and figures next to ours.
///
/// Every step leaves its outcome in a folder, so a run that was interrupted continues where it stopped, and networks that lie
/// in --runs already are taken as they are: RUNS/sim-udi/{metric,sigmoid,softmax,metric-open,mluc-full,supervised,osis}/model.safetensors,
/// further seeds in metric-s2 and so on. The full plan takes hours on two cores; --quick twelve minutes.
#[derive(Args)]
pub(crate) struct ReproduceArguments {
    #[command(flatten)]
    options: Options,
    #[command(flatten)]
    threads: Threads,
}

pub(crate) fn run_command(arguments: ReproduceArguments) -> anyhow::Result<()> {
    arguments.threads.start()?;
    let mut options = arguments.options;
    options.program = std::env::current_exe().context("the path of this program")?;
    options.commit = commit();
    let style = "{prefix} {msg} [{bar:30}] {pos}/{len}, {eta} left of this";
    let screen = Progress::new("", 0, style);
    let report = run(&options, &screen)?;
    screen.clear();
    print_out(report.display())
}

impl Screen for Progress {
    fn step(&self, number: usize, steps: usize, name: &str) {
        let step = format!("[{number}/{steps}]");
        Progress::note(self, &format!("{step} {name}"));
        self.bar.set_prefix(step);
    }

    fn count(&self, what: &str, total: u64) {
        self.wait_with_lines();
        self.bar.reset();
        self.bar.set_length(total);
        self.bar.set_message(what.to_owned());
    }

    fn tick(&self) {
        self.bar.inc(1);
        let bar = &self.bar;
        let (step, what, done) = (bar.prefix(), bar.message(), bar.position());
        let total = bar.length().unwrap_or(done);
        self.line(false, format_args!("{step} {what}: {done}/{total}"));
    }

    fn note(&self, text: &str) {
        Progress::note(self, text);
    }

    fn clear(&self) {
        self.bar.set_length(0);
        self.bar.finish_and_clear();
    }
}
