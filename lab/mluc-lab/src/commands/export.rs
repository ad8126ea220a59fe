//! `mluc-lab export`: a model file as safetensors with documented names.

use super::terminal::write_out;
use clap::Args;
use mluc_lab::exchange::export;
use mluc_model::Model;
use std::path::PathBuf;

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

pub(crate) fn run(arguments: ExportArguments) -> anyhow::Result<()> {
    let bytes = export(&Model::read(&arguments.model)?)?;
    let out = &arguments.out;
    anyhow::ensure!(
        out.canonicalize().ok() != arguments.model.canonicalize().ok(),
        "--out: expected another file than --model, found the same, {}",
        out.display()
    );
    write_out(out, &bytes)
}
