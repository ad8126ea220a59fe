//! What can go wrong in training.

use std::path::PathBuf;

use crate::dataset::DatasetError;

/// Why training stopped.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// The data set cannot be read.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// A training split without objects of a class.
    #[error("{}: expected objects of every class in the training split, found no {class}", path.display())]
    NoObjects {
        /// The split.
        path: PathBuf,
        /// The class.
        class: String,
    },
    /// A file of the run cannot be read or written.
    #[error("{}: {cause}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's answer.
        cause: std::io::Error,
    },
    /// A checkpoint that is not one, or not of this run.
    #[error("{}: expected {expected}, found {found}; move it away to start anew", path.display())]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// What this run needs.
        expected: String,
        /// What is there.
        found: String,
    },
    /// A folder that another run writes to now.
    #[error("{}: expected a folder of no other run, found another run training into it; wait for it, or name another folder", path.display())]
    Busy {
        /// The folder.
        path: PathBuf,
    },
    /// A file that this run would write over and did not make.
    #[error("{}: expected no file of another run (its checkpoint is not beside it, or is of another kind), found one; move it away or name another folder", path.display())]
    NotOurs {
        /// The file.
        path: PathBuf,
    },
    /// Labelled boxes without points.
    #[error("{}: expected points in the labelled boxes, found none in its first {frames} frames: empty scans, or labels of other ones?", path.display())]
    NoPoints {
        /// The split.
        path: PathBuf,
        /// Frames looked at.
        frames: usize,
    },
    /// A network to start from that shares nothing.
    #[error("{}: expected layers or head rows of the network to be trained, found none", path.display())]
    NothingTaken {
        /// The model file.
        path: PathBuf,
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
    /// The refiner refuses the model's sensor.
    #[error(transparent)]
    Refiner(#[from] mluc_refiner::RefinerError),
    /// The thread that prepares batches ended early.
    #[error("the thread that prepares batches ended before step {step}")]
    LoaderEnded {
        /// The step that it owed.
        step: u64,
    },
    /// A setting out of its range.
    #[error("{name}: expected {expected}, found {found}")]
    Setting {
        /// The option.
        name: &'static str,
        /// Its range.
        expected: &'static str,
        /// The value.
        found: String,
    },
}
