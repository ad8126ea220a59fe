//! Errors in an evaluation's inputs.

use mluc_backbone::BackboneError;
use mluc_dataset::DatasetError;
use mluc_head::HeadError;
use mluc_model::ModelError;
use mluc_refiner::RefinerError;
use std::path::Path;

/// Why detections or a model cannot be evaluated.
#[derive(Debug, thiserror::Error)]
pub enum EvaluateError {
    /// An error in a scan, label, detection or calibration file.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// An error in the model file.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The model does not fit the backbone.
    #[error(transparent)]
    Backbone(#[from] BackboneError),
    /// The model does not fit the head.
    #[error(transparent)]
    Head(#[from] HeadError),
    /// An error in the refiner's settings, or in the model's beams.
    #[error(transparent)]
    Refiner(#[from] RefinerError),
    /// A file, a folder or another input that cannot be used: what was expected and found, or the system's error.
    #[error("{0}")]
    Input(String),
}

/// Result of an evaluation.
pub type Result<T, E = EvaluateError> = std::result::Result<T, E>;

impl EvaluateError {
    /// An error of a file or folder.
    pub fn file(path: &Path, what: impl std::fmt::Display) -> EvaluateError {
        EvaluateError::Input(format!("{}: {what}", path.display()))
    }
}
