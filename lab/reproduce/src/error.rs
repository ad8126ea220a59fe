//! What can stop a reproduction.

use mluc_dataset::DatasetError;
use mluc_evaluate::EvaluateError;
use mluc_model::ModelError;
use mluc_refiner::RefinerError;
use mluc_simulate::SimulateError;
use std::path::{Path, PathBuf};

/// Why a reproduction stopped. What was done before stays; the same command goes on from there.
#[derive(Debug, thiserror::Error)]
pub enum ReproduceError {
    /// Simulated scans cannot be made.
    #[error(transparent)]
    Simulate(#[from] SimulateError),
    /// A data set cannot be read.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// A network cannot be run or judged.
    #[error(transparent)]
    Evaluate(#[from] EvaluateError),
    /// A model file cannot be read.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The refiner's settings, or the model's beams.
    #[error(transparent)]
    Refiner(#[from] RefinerError),
    /// A method that cannot run on a model: which, what was expected and found.
    #[error("{0}")]
    Method(String),
    /// The trainer ended with a fault, which it has written to stderr.
    #[error(
        "training {network}: expected exit status 0, found {status}; the command was: {command}"
    )]
    Training {
        /// Kind of network.
        network: &'static str,
        /// The system's words.
        status: String,
        /// What was run.
        command: String,
    },
    /// A file or folder: what was expected there and what was found, or the system's answer.
    #[error("{}: {what}", path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
}

impl ReproduceError {
    /// A fault of a file or folder.
    pub(crate) fn file(path: &Path, what: impl std::fmt::Display) -> ReproduceError {
        ReproduceError::File {
            path: path.to_owned(),
            what: what.to_string(),
        }
    }
}

/// Writes a file that is whole or not there. Makes the folder.
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), ReproduceError> {
    let folder = path.parent().unwrap_or(path);
    std::fs::create_dir_all(folder).map_err(|e| ReproduceError::file(folder, e))?;
    mluc_dataset::whole_file::write_whole(path, bytes).map_err(|e| ReproduceError::file(path, e))
}
