//! `mluc exec`: ties this process to the supervisor and becomes another program.

use std::os::unix::process::CommandExt;
use std::process::{Command, ExitCode};

use anyhow::Context;

use crate::cli::ExecArgs;
use crate::placement::pin;
use crate::stages::end_with;

pub(crate) fn exec(args: ExecArgs) -> anyhow::Result<ExitCode> {
    end_with(args.supervised_by)?;
    if let Some(cpus) = &args.cpus {
        pin(cpus)?;
    }
    let (program, arguments) = args.command.split_first().context("no program given")?;
    // Only returns when it fails.
    let error = Command::new(program).args(arguments).exec();
    Err(error).with_context(|| format!("starting {program}"))
}
