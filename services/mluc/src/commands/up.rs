//! `mluc up`: the pipeline on scans, JSON lines on stdout.

use std::process::ExitCode;

use anyhow::Context;
use mluc_runtime::log_to_stderr;

use crate::cli::PipelineArgs;
use crate::settings::Settings;
use crate::supervisor::{LineWriter, run};

pub(crate) fn up(args: PipelineArgs) -> anyhow::Result<ExitCode> {
    log_to_stderr("up", "info");
    let settings = Settings::resolve(args)?;
    let mut lines = LineWriter::new(settings.pace, std::io::stdout());
    let outcome = run(&settings, &mut lines)?;
    let unread = lines.finish().context("writing JSON lines to stdout")?;
    eprint!("{}", outcome.latencies.table());
    eprintln!(
        "frames: {} in, {} out, {} lost; stages restarted: {}",
        outcome.frames_in,
        outcome.frames_out,
        outcome.frames_lost(),
        outcome.restarts
    );
    if unread > 0 {
        eprintln!("{unread} lines dropped: the reader of stdout was too slow");
    }
    Ok(ExitCode::from(outcome.exit_code()))
}
