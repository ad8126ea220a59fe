//! Output of the commands, and common options. A full or closed terminal or file must not stop the work.

use anyhow::Context;
use clap::builder::{PossibleValuesParser, RangedU64ValueParser, TypedValueParser};
use indicatif::{ProgressBar, ProgressStyle};
use mluc_dataset::whole_file::write_whole;
use std::{fmt::Display, path::Path, time::Duration, time::Instant};
use std::{io::IsTerminal, io::Write, io::stderr, io::stdout, sync::Mutex, sync::PoisonError};

/// Prints a line on stderr; a failure is ignored.
pub(crate) fn print_err(text: impl Display) {
    let _ = writeln!(stderr(), "{text}");
}

/// Prints a line of the command's result on stdout.
pub(crate) fn print_out(text: impl Display) -> anyhow::Result<()> {
    writeln!(stdout(), "{text}").context("standard output")
}

/// Writes a file completely or not at all, and prints its path.
pub(crate) fn write_out(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    write_whole(path, bytes).with_context(|| path.display().to_string())?;
    print_out(path.display())
}

/// Time between progress lines without a terminal.
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

    /// Prints a line where there is no bar, if the last line is old enough or `must` is set.
    pub(crate) fn line(&self, must: bool, text: impl Display) {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let is_due = last.is_none_or(|last| last.elapsed() >= LINE_EVERY);
        if !self.is_terminal && (is_due || must) {
            print_err(text);
            *last = Some(Instant::now());
        }
    }

    /// Prints a line in any case.
    pub(crate) fn note(&self, text: &str) {
        if self.is_terminal {
            self.bar.println(text);
        } else {
            print_err(text);
        }
    }

    /// Delays the next line by the time between two lines.
    pub(crate) fn wait_with_lines(&self) {
        *self.last.lock().unwrap_or_else(PoisonError::into_inner) = Some(Instant::now());
    }
}

/// Runs `work` with a function that it calls after each frame; a bar or a line now and then shows the count.
pub(crate) fn counted<T>(of: &str, frames: usize, work: impl FnOnce(&(dyn Fn() + Sync)) -> T) -> T {
    let style = "{msg} [{bar:40}] {pos}/{len} frames, {per_sec}, {eta} left";
    let progress = Progress::new(of, frames as u64, style);
    let bar = &progress.bar;
    let result = work(&|| {
        bar.inc(1);
        let done = bar.position() as usize;
        progress.line(done == frames, format_args!("{of}: {done}/{frames} frames"));
    });
    bar.finish_and_clear();
    result
}

/// Parser of an option's value by name.
pub(crate) fn one_of<T: Copy + Send + Sync + 'static>(
    all: &'static [T],
    name: fn(T) -> &'static str,
) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(all.iter().map(|value| name(*value))).map(move |given| {
        let found = all.iter().find(|value| name(**value) == given);
        *found.expect("clap has compared the names")
    })
}

/// Threads of a command.
#[derive(clap::Args)]
pub(crate) struct Threads {
    /// Threads; 0: all cores.
    #[arg(long, default_value_t = 0, value_parser = RangedU64ValueParser::<usize>::new().range(..=256))]
    threads: usize,
}

impl Threads {
    /// Starts the thread pool of this process.
    pub(crate) fn start(&self) -> anyhow::Result<()> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(self.threads);
        pool.build_global().context("the threads cannot be started")
    }
}
