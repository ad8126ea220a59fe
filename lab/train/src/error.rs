//! What can go wrong in training.

use std::{fmt::Display, path::Path};

use mluc_dataset::DatasetError;

/// Why training stopped.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// The data set cannot be read.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// The model file could not be made.
    #[error(transparent)]
    Model(#[from] mluc_model::ModelError),
    /// The inference engine refuses the model.
    #[error(transparent)]
    Backbone(#[from] mluc_backbone::BackboneError),
    /// The validation scans cannot be read, or judged with the model.
    #[error(transparent)]
    Evaluate(#[from] mluc_evaluate::EvaluateError),
    /// The refiner refuses the model's sensor.
    #[error(transparent)]
    Refiner(#[from] mluc_refiner::RefinerError),
    /// A file that cannot be read or written, or that this run must not use; a setting out of its range, a loss that is no
    /// number, data in which nothing is seen, a thread that ended.
    #[error("{0}")]
    Stopped(String),
}

impl TrainError {
    /// The loss of `step` is no longer a number.
    pub(crate) fn diverged(step: u64, loss: f64) -> TrainError {
        TrainError::Stopped(format!(
            "step {step}: the loss is {loss}; a lower learning rate may help, unless a scan or a label is wrong"
        ))
    }

    /// A file of the run cannot be read or written.
    pub(crate) fn io(path: &Path, cause: std::io::Error) -> TrainError {
        TrainError::Stopped(format!("{}: {cause}", path.display()))
    }

    /// A file or folder that this run cannot use, or must not write over.
    pub(crate) fn refused(path: &Path, expected: impl Display, found: impl Display) -> TrainError {
        let path = path.display();
        TrainError::Stopped(format!("{path}: expected {expected}, found {found}"))
    }
}
