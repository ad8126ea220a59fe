//! What can be wrong with an evaluation's inputs.

use mluc_backbone::BackboneError;
use mluc_dataset::DatasetError;
use mluc_head::HeadError;
use mluc_model::ModelError;
use mluc_refiner::RefinerError;
use std::path::Path;

/// Why detections or a model cannot be judged.
#[derive(Debug, thiserror::Error)]
pub enum EvaluateError {
    /// A scan, label, detection or calibration file.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// The model file.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The model does not fit the backbone.
    #[error(transparent)]
    Backbone(#[from] BackboneError),
    /// The model does not fit the head.
    #[error(transparent)]
    Head(#[from] HeadError),
    /// The refiner's settings, or the model's beams.
    #[error(transparent)]
    Refiner(#[from] RefinerError),
    /// A file or folder, or anything else that was asked for and cannot be: what was expected and found, or the system's answer.
    #[error("{0}")]
    Input(String),
}

/// What an evaluation gives.
pub type Result<T, E = EvaluateError> = std::result::Result<T, E>;

impl EvaluateError {
    /// A fault of a file or folder.
    pub fn file(path: &Path, what: impl std::fmt::Display) -> EvaluateError {
        EvaluateError::Input(format!("{}: {what}", path.display()))
    }
}
