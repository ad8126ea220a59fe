//! `mluc up`: the pipeline on scans, JSON lines on stdout.

use std::process::ExitCode;

use anyhow::Context;
use mluc_runtime::log_to_stderr;

use crate::cli::PipelineArgs;
use crate::settings::Settings;
use crate::supervisor::{LineWriter, run};
use crate::terminal::tell;

pub(crate) fn up(args: PipelineArgs) -> anyhow::Result<ExitCode> {
    log_to_stderr("up", "info");
    let settings = Settings::resolve(args)?;
    let mut lines = LineWriter::new(settings.pace, std::io::stdout());
    let outcome = run(&settings, &mut lines)?;
    let unread = lines.finish().context("writing JSON lines to stdout")?;
    tell(outcome.latencies.table().trim_end());
    tell(format_args!(
        "frames: {} in, {} out, {} lost; stages restarted: {}",
        outcome.frames_in,
        outcome.frames_out,
        outcome.frames_lost(),
        outcome.restarts
    ));
    if unread > 0 {
        tell(format_args!(
            "{unread} lines dropped: the reader of stdout was too slow"
        ));
    }
    Ok(ExitCode::from(outcome.exit_code()))
}
