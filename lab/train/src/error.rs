//! What can go wrong in training.

use std::path::{Path, PathBuf};

use mluc_dataset::DatasetError;

/// Why training stopped.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// The data set cannot be read.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// A file of the run cannot be read or written.
    #[error("{}: {cause}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's answer.
        cause: std::io::Error,
    },
    /// A file or folder that this run cannot use, or must not write over.
    #[error("{}: expected {expected}, found {found}", path.display())]
    Refused {
        /// The file or folder.
        path: PathBuf,
        /// What this run needs.
        expected: String,
        /// What is there, and what to do about it.
        found: String,
    },
    /// The loss is no longer a number.
    #[error(
        "step {step}: the loss is {found}; a lower learning rate may help, unless a scan or a label is wrong"
    )]
    Diverged {
        /// When.
        step: u64,
        /// What the loss is.
        found: f64,
    },
    /// The model file could not be made.
    #[error(transparent)]
    Model(#[from] mluc_model::ModelError),
    /// The inference engine refuses the model.
    #[error(transparent)]
    Backbone(#[from] mluc_backbone::BackboneError),
    /// The head refuses the model.
    #[error(transparent)]
    Head(#[from] mluc_head::HeadError),
    /// The validation scans cannot be read, or judged with the model.
    #[error(transparent)]
    Evaluate(#[from] mluc_evaluate::EvaluateError),
    /// The refiner refuses the model's sensor.
    #[error(transparent)]
    Refiner(#[from] mluc_refiner::RefinerError),
    /// The thread that prepares batches ended early.
    #[error("the thread that prepares batches ended before step {step}")]
    LoaderEnded {
        /// The step that it owed.
        step: u64,
    },
    /// No range of int8 can be chosen where no value was seen.
    #[error(
        "the data: expected scans with points inside the model's range, found {frames} frames that leave a layer at 0"
    )]
    NothingSeen {
        /// Frames that were run.
        frames: usize,
    },
    /// A setting out of its range.
    #[error("{name}: expected {expected}, found {found}")]
    Setting {
        /// The option.
        name: &'static str,
        /// Its range.
        expected: String,
        /// The value.
        found: String,
    },
}

impl TrainError {
    pub(crate) fn io(path: &Path, cause: std::io::Error) -> TrainError {
        let path = path.to_owned();
        TrainError::Io { path, cause }
    }

    pub(crate) fn refused(
        path: &Path,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> TrainError {
        TrainError::Refused {
            path: path.to_owned(),
            expected: expected.into(),
            found: found.into(),
        }
    }
}
