//! Commands that are programs of their own, as cargo's subcommands are: `mluc` only finds and becomes them.

use std::process::{Command, ExitCode};
use std::{ffi::OsString, io::ErrorKind, os::unix::process::CommandExt, path::PathBuf};

use anyhow::{Context, bail};
use clap::Args;

/// Arguments that are passed on as they are, `--help` too.
#[derive(Args, Clone, Debug)]
#[command(disable_help_flag = true)]
pub(crate) struct ExternalArgs {
    /// Arguments of the program.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    _arguments: Vec<OsString>,
}

/// The program of this name: the file beside this program where there is one, else the bare name, which is looked up on PATH when it is started.
pub fn installed_program(name: &str) -> PathBuf {
    let own = std::env::current_exe().unwrap_or_default();
    let beside = Some(own.with_file_name(name)).filter(|path| path.is_file());
    beside.unwrap_or_else(|| PathBuf::from(name))
}

/// Becomes `program`, which lies beside this one or on PATH, with `first` and what stands behind the command's name. The
/// cargo package that holds it has its name.
pub(crate) fn external(program: &str, first: &[&str]) -> anyhow::Result<ExitCode> {
    // As they came: clap would leave out the first `--`. Only returns when it fails.
    let error = Command::new(installed_program(program))
        .args(first)
        .args(std::env::args_os().skip(2))
        .exec();
    if error.kind() == ErrorKind::NotFound {
        let own = std::env::current_exe().unwrap_or_default();
        bail!(
            "{program} is not installed: expected it beside {} or on PATH; in a checkout, `cargo build --release -p \
             {program}` makes it",
            own.display()
        );
    }
    Err(error).with_context(|| format!("starting {program}"))
}
