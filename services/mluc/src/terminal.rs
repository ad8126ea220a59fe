//! The output of a command. A full or closed terminal or file causes an error at most, never a panic while stages run.

use anyhow::Context;
use mluc_runtime::{LOG_FORMATS, PatientStderr, log_format, log_line};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::{fmt::Display, io::Write, io::stdout, time::Duration};
use tracing::Level;

/// How long a write waits for the reader of stderr. The next one does not wait again for a reader that stands still.
const PATIENCE: Duration = Duration::from_secs(1);
static IS_STALLED: AtomicBool = AtomicBool::new(false);

/// Writes a line to stderr; it is lost if it cannot be written. If the log is JSON, the line is a JSON line of the log.
pub fn print_err(text: impl Display) {
    print_at(Level::INFO, text);
}

/// Like [`print_err`], with another level than `INFO`.
pub fn print_at(level: Level, text: impl Display) {
    let text = text.to_string();
    let is_json = log_format() == LOG_FORMATS[1];
    let line = if is_json { log_line("mluc", level, &text, &[]) } else { text };
    let text = line + "\n";
    let patience = if IS_STALLED.load(Relaxed) { Duration::ZERO } else { PATIENCE };
    IS_STALLED.store(!PatientStderr(patience).is_ready(), Relaxed);
    let _ = PatientStderr(Duration::ZERO).write_all(text.as_bytes());
}

/// Writes a line of the command's result to stdout.
pub fn print_out(text: impl Display) -> anyhow::Result<()> {
    writeln!(stdout(), "{text}").context("standard output")
}
