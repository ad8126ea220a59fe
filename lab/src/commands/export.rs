//! `mluc-lab export`: a model file as safetensors with documented names.

use std::path::PathBuf;

use anyhow::Context;
use clap::Args;
use mluc_lab::exchange::export;
use mluc_model::Model;

/// Write a model's weights as safetensors with the names that OpenPCDet gives its layers (docs/weights.md).
///
/// `mluc-lab import` turns the file into the same model again.
#[derive(Args)]
pub(crate) struct ExportArguments {
    /// Model file.
    #[arg(long, value_name = "FILE")]
    model: PathBuf,
    /// The file to be written.
    #[arg(long, value_name = "FILE.safetensors")]
    out: PathBuf,
}

/// Runs it.
pub(crate) fn run(arguments: ExportArguments) -> anyhow::Result<()> {
    let bytes = export(&Model::read(&arguments.model)?)?;
    let out = &arguments.out;
    std::fs::write(out, bytes).with_context(|| out.display().to_string())?;
    println!("{}", out.display());
    Ok(())
}
