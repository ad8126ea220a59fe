//! What can go wrong in training.

use std::{fmt::Display, path::Path};

/// Why training stopped: as in an evaluation, or a file that this run must not use, a setting out of its range, a loss that is no number, data in
/// which nothing is seen, a thread that ended.
pub type TrainError = mluc_evaluate::EvaluateError;

/// The loss of `step` is no longer a number.
pub(crate) fn diverged(step: u64, loss: f64) -> TrainError {
    TrainError::Input(format!(
        "step {step}: the loss is {loss}; a lower learning rate may help, unless a scan or a label is wrong"
    ))
}

/// A file or folder that this run cannot use, or must not write over.
pub(crate) fn refused(path: &Path, expected: impl Display, found: impl Display) -> TrainError {
    TrainError::file(path, format!("expected {expected}, found {found}"))
}
