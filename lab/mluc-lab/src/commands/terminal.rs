//! What commands print, and what their options share. A terminal or file that is full or closed must not stop the work.

use mluc_dataset::whole_file::write_whole;
use std::io::{IsTerminal, Write, stderr, stdout};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};
use std::{fmt::Display, path::Path};

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

/// Writes a file, whole or not at all, and answers with its path.
pub(crate) fn write_out(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    write_whole(path, bytes).with_context(|| path.display().to_string())?;
    print_out(path.display())
}

/// Without a terminal, a line this often.
const LINE_EVERY: Duration = Duration::from_secs(30);

/// A progress bar on a terminal, lines elsewhere; always on stderr.
pub(crate) struct Progress {
    pub(crate) bar: ProgressBar,
    pub(crate) is_terminal: bool,
    /// When the last line was printed.
    last: Mutex<Option<Instant>>,
}

impl Progress {
    pub(crate) fn new(what: &str, total: u64, style: &str) -> Progress {
        let style = ProgressStyle::with_template(style).expect("a constant template");
        let bar = ProgressBar::new(total).with_style(style);
        Progress {
            bar: bar.with_message(what.to_owned()),
            is_terminal: stderr().is_terminal(),
            last: Mutex::default(),
        }
    }

    /// A line where there is no bar and the last line is long ago, or where it `must` be.
    pub(crate) fn line(&self, must: bool, text: impl Display) {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let is_due = last.is_none_or(|last| last.elapsed() >= LINE_EVERY);
        if !self.is_terminal && (is_due || must) {
            print_err(text);
            *last = Some(Instant::now());
        }
    }

    /// A line in any case.
    pub(crate) fn note(&self, text: &str) {
        if self.is_terminal {
            self.bar.println(text);
        } else {
            print_err(text);
        }
    }

    /// The next line is due after the time between two.
    pub(crate) fn wait_with_lines(&self) {
        *self.last.lock().unwrap_or_else(PoisonError::into_inner) = Some(Instant::now());
    }
}

/// Does work that calls what it is given after each frame; on a terminal a bar counts them.
pub(crate) fn counted<T>(
    what: &str,
    frames: usize,
    work: impl FnOnce(&(dyn Fn() + Sync)) -> T,
) -> T {
    let style = "{msg} [{bar:40}] {pos}/{len} frames, {per_sec}, {eta} left";
    let bar = Progress::new(what, frames as u64, style).bar;
    let result = work(&|| bar.inc(1));
    bar.finish_and_clear();
    result
}

/// An option's value by its name.
pub(crate) fn one_of<T: Copy + Send + Sync + 'static>(
    all: &'static [T],
    name: fn(T) -> &'static str,
) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(all.iter().map(|value| name(*value))).map(move |given| {
        let found = all.iter().find(|value| name(**value) == given);
        *found.expect("clap has compared the names")
    })
}

/// A number that may not be 0.
pub(crate) fn at_least_one(text: &str) -> Result<usize, String> {
    let number = text.parse().ok().filter(|number| *number > 0);
    number.ok_or_else(|| format!("expected 1 or more, found {text}"))
}

/// Threads of a command.
#[derive(clap::Args)]
pub(crate) struct Threads {
    /// Threads; 0: all cores.
    #[arg(long, default_value_t = 0, value_parser = threads)]
    threads: usize,
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
