//! Commands that are separate programs, like cargo's subcommands: `mluc` only finds the program and replaces itself with it.

use anyhow::{Context, bail};
use clap::Args;
use mluc_runtime::{LOG_FORMAT_VARIABLE, log_format};
use std::process::{Command, ExitCode};
use std::{ffi::OsString, io::ErrorKind, os::unix::process::CommandExt, path::PathBuf};

/// Arguments that are passed on as they are, `--help` too.
#[derive(Args, Clone, Debug)]
#[command(disable_help_flag = true)]
pub(crate) struct ExternalArgs {
    /// Arguments of the program.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    _arguments: Vec<OsString>,
}

/// The program of this name: the file next to this program if there is one, else the bare name, which is looked up on PATH at its start.
pub fn installed_program(name: &str) -> PathBuf {
    let own = std::env::current_exe().unwrap_or_default();
    let beside = Some(own.with_file_name(name)).filter(|path| path.is_file());
    beside.unwrap_or_else(|| PathBuf::from(name))
}

/// This program's file; if it was removed or replaced since the start, the image that is running.
pub(crate) fn own_program() -> PathBuf {
    let path = std::env::current_exe().ok().filter(|path| path.exists());
    // With the process id and not `self`: other processes start it too.
    path.unwrap_or_else(|| format!("/proc/{}/exe", std::process::id()).into())
}

/// Replaces this process with `program`, which is next to this program or on PATH. Its arguments are `first` and the words
/// after the command's name. The cargo package of the program has the same name.
pub(crate) fn external(program: &str, first: &[&str]) -> anyhow::Result<ExitCode> {
    // The arguments as they came (clap would drop the first `--`), except the option of the log format before a `--`, which is ours.
    let (mut own, mut format) = (Vec::<OsString>::new(), OsString::from(log_format()));
    let mut words = std::env::args_os().skip(1);
    while let Some(word) = words.next() {
        let text = word.to_str().filter(|_| !own.contains(&"--".into()));
        match text.and_then(|text| text.strip_prefix("--log-format")) {
            Some("") => format = words.next().unwrap_or_default(),
            Some(value) if value.starts_with('=') => format = OsString::from(&value[1..]),
            _ => own.push(word),
        }
    }
    // `exec` only returns when it fails.
    let mut command = Command::new(installed_program(program));
    command.args(first).args(own.iter().skip(1));
    let error = command.env(LOG_FORMAT_VARIABLE, format).exec();
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
