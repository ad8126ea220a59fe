//! What a command says, and what its options share. A terminal or file that is full or closed must not take the work along.

use std::fmt::Display;
use std::io::{Write, stderr, stdout};

use anyhow::Context;

/// A line on stderr, lost where it cannot be written.
pub(crate) fn tell(text: impl Display) {
    let _ = writeln!(stderr(), "{text}");
}

/// The command's answer, a line on stdout.
pub(crate) fn answer(text: impl Display) -> anyhow::Result<()> {
    writeln!(stdout(), "{text}").context("standard output")
}

/// A number of threads: 0 for all cores, at most four a core (64 are taken on any machine).
pub(crate) fn threads(text: &str) -> Result<usize, String> {
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
    let most = (4 * cores).max(64);
    let number = text.parse().ok().filter(|n| *n <= most);
    number.ok_or_else(|| format!("expected 0 to {most}, found '{text}'"))
}
