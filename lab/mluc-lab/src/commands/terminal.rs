//! What commands print, and what their options share. A terminal or file that is full or closed must not stop the work.

use std::fmt::Display;
use std::io::{Write, stderr, stdout};

use anyhow::Context;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use indicatif::{ProgressBar, ProgressStyle};

/// A line on stderr, lost where it cannot be written.
pub(crate) fn print_err(text: impl Display) {
    let _ = writeln!(stderr(), "{text}");
}

/// The command's answer, a line on stdout.
pub(crate) fn print_out(text: impl Display) -> anyhow::Result<()> {
    writeln!(stdout(), "{text}").context("standard output")
}

/// A progress bar on stderr, shown only where that is a terminal.
pub(crate) fn bar(what: &str, total: u64, style: &str) -> ProgressBar {
    let bar = ProgressBar::new(total).with_message(what.to_owned());
    if let Ok(style) = ProgressStyle::with_template(style) {
        bar.set_style(style);
    }
    bar
}

/// A [`bar`] that counts frames.
pub(crate) fn frames_bar(what: &str, frames: usize) -> ProgressBar {
    let style = "{msg} [{bar:40}] {pos}/{len} frames, {per_sec}, {eta} left";
    bar(what, frames as u64, style)
}

/// An option's value by its name.
pub(crate) fn one_of<T: Copy + Send + Sync + 'static>(
    all: &'static [T],
    name: fn(T) -> &'static str,
) -> impl TypedValueParser<Value = T> {
    let names = all.iter().map(|value| name(*value));
    PossibleValuesParser::new(names).try_map(move |given| {
        let found = all.iter().find(|value| name(**value) == given);
        found.copied().ok_or(NotNamed)
    })
}

/// Never seen: clap has compared the names.
#[derive(Debug, thiserror::Error)]
#[error("no such value")]
struct NotNamed;

/// Threads of a command.
#[derive(clap::Args)]
pub(crate) struct Threads {
    /// Threads; 0: all cores.
    #[arg(long, default_value_t = 0, value_parser = threads)]
    pub(crate) threads: usize,
}

impl Threads {
    /// Makes the pool that everything of this process runs on.
    pub(crate) fn start(&self) -> anyhow::Result<()> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(self.threads);
        pool.build_global().context("the threads cannot be started")
    }
}

/// A number of threads: 0 for all cores, at most four a core (64 are taken on any machine).
fn threads(text: &str) -> Result<usize, String> {
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
    let most = (4 * cores).max(64);
    let number = text.parse().ok().filter(|n| *n <= most);
    number.ok_or_else(|| format!("expected 0 to {most}, found '{text}'"))
}
