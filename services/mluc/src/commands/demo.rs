//! `mluc demo`.

use std::process::ExitCode;

use crate::cli::DemoArgs;

pub(crate) fn demo(_args: DemoArgs) -> anyhow::Result<ExitCode> {
    anyhow::bail!("to be written")
}
