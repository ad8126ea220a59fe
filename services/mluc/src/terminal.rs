//! What a command says. A terminal or file that is full or closed is an error at most, never a panic beside running stages.

use std::io::{Write, stdout};
use std::{fmt::Display, time::Duration};

use anyhow::Context;
use mluc_runtime::{LOG_FORMATS, PatientStderr, log_format, log_line};
use tracing::Level;

/// How long a reader of stderr is waited for.
const PATIENCE: Duration = Duration::from_secs(1);

/// A line on stderr, lost where it cannot be written; where the log is JSON, it is one of its lines.
pub fn print_err(text: impl Display) {
    print_at(Level::INFO, text);
}

/// The same of another level than `INFO`.
pub fn print_at(level: Level, text: impl Display) {
    let text = text.to_string();
    let is_json = log_format() == LOG_FORMATS[1];
    let line = is_json.then(|| log_line("mluc", level, &text, &[]));
    let text = line.unwrap_or(text) + "\n";
    let _ = PatientStderr(PATIENCE).write_all(text.as_bytes());
}

/// A line of the command's answer, on stdout.
pub fn print_out(text: impl Display) -> anyhow::Result<()> {
    writeln!(stdout(), "{text}").context("standard output")
}
