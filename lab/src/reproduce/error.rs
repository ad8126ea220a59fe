//! What can stop a reproduction.

use crate::dataset::DatasetError;
use crate::evaluate::EvaluateError;
use crate::methods::MethodError;
use crate::pipeline::PipelineError;
use crate::simulate::SimulateError;
use mluc_model::ModelError;
use std::path::PathBuf;

/// Why a reproduction stopped. What was done before stays; the same command goes on from there.
#[derive(Debug, thiserror::Error)]
pub enum ReproduceError {
    /// Simulated scans cannot be made.
    #[error(transparent)]
    Simulate(#[from] SimulateError),
    /// A data set cannot be read.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// Figures cannot be taken.
    #[error(transparent)]
    Evaluate(#[from] EvaluateError),
    /// A network cannot be run.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    /// A model file cannot be read.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A row cannot be run.
    #[error(transparent)]
    Row(#[from] MethodError),
    /// A model that its row does not stand on.
    #[error("{}: {cause}", path.display())]
    OtherNetwork {
        /// The model file.
        path: PathBuf,
        /// Why not.
        cause: MethodError,
    },
    /// A method cannot be run.
    #[error("{method}: {reason}")]
    Method {
        /// The row.
        method: &'static str,
        /// Why.
        reason: String,
    },
    /// A folder of scans that is too small or not finished.
    #[error("{}: expected a data set of at least {expected} frames, found {found}; move it away to have it simulated, or name another --data", path.display())]
    TooFewFrames {
        /// The folder.
        path: PathBuf,
        /// Frames of the plan.
        expected: usize,
        /// Frames there.
        found: usize,
    },
    /// The trainer ended with a fault, which it has told on stderr.
    #[error(
        "training {network}: expected exit status 0, found {status}; the command was: {command}"
    )]
    Training {
        /// Kind of network.
        network: String,
        /// The system's words.
        status: String,
        /// What was run.
        command: String,
    },
    /// Nothing to evaluate.
    #[error("{}: expected a trained network of at least one kind (NETWORK/model.safetensors), found none", path.display())]
    NoNetworks {
        /// The folder.
        path: PathBuf,
    },
    /// A model of another setting.
    #[error("{}: expected a model of setting {expected}, found {found}", path.display())]
    OtherSetting {
        /// The file.
        path: PathBuf,
        /// The plan's.
        expected: &'static str,
        /// The model's.
        found: String,
    },
    /// A file or folder cannot be made, read or written.
    #[error("{}: {cause}", path.display())]
    Io {
        /// Which.
        path: PathBuf,
        /// The system's answer.
        cause: std::io::Error,
    },
    /// A picture cannot be written.
    #[error("{}: {reason}", path.display())]
    Picture {
        /// Which.
        path: PathBuf,
        /// Why.
        reason: String,
    },
}

impl ReproduceError {
    /// A fault of the file system, with its place.
    pub(super) fn io(path: &std::path::Path) -> impl FnOnce(std::io::Error) -> ReproduceError {
        let path = path.to_owned();
        move |cause| ReproduceError::Io { path, cause }
    }
}
