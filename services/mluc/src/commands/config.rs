//! `mluc config`: the settings of a run, without the run.

use std::process::ExitCode;

use mluc_runtime::log_to_stderr;

use crate::cli::ConfigArgs;
use crate::resolve::Resolved;
use crate::terminal::print_out;

pub(crate) fn config(args: ConfigArgs) -> anyhow::Result<ExitCode> {
    log_to_stderr("config", "warn");
    let mut resolved = Resolved::of(args.pipeline, false)?;
    resolved.load_model()?;
    if args.print {
        print_out(resolved.print()?.trim_end())?;
    }
    Ok(ExitCode::SUCCESS)
}
