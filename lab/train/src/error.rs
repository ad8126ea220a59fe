//! Errors in training.

use std::{fmt::Display, path::Path};

/// Why training stopped: an error as in an evaluation, a file that this run must not use, a setting out of its range, a non-finite loss, data without
/// visible objects, or a thread that ended.
pub type TrainError = mluc_evaluate::EvaluateError;

/// The loss of `step` is not a finite number.
pub(crate) fn diverged(step: u64, loss: f64) -> TrainError {
    TrainError::Input(format!(
        "step {step}: the loss is {loss}; a lower learning rate may help, unless a scan or a label is wrong"
    ))
}

/// A file or folder that this run cannot use, or must not overwrite.
pub(crate) fn refused(path: &Path, expected: impl Display, found: impl Display) -> TrainError {
    TrainError::file(path, format!("expected {expected}, found {found}"))
}
