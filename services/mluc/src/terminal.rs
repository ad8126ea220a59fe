//! What a command says. A terminal or file that is full or closed is an error at most, never a panic beside running stages.

use std::fmt::Display;
use std::io::{Write, stderr, stdout};

use anyhow::Context;

/// A line on stderr, lost where it cannot be written.
pub fn print_err(text: impl Display) {
    let _ = writeln!(stderr(), "{text}");
}

/// A line of the command's answer, on stdout.
pub fn print_out(text: impl Display) -> anyhow::Result<()> {
    writeln!(stdout(), "{text}").context("standard output")
}
