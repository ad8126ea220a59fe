//! Why a model cannot be judged.

use crate::dataset::DatasetError;
use crate::evaluate::EvaluateError;
use mluc_backbone::BackboneError;
use mluc_head::HeadError;
use mluc_model::ModelError;
use mluc_refiner::RefinerError;
use std::path::PathBuf;

/// A model, a stage or the data.
#[derive(Debug, thiserror::Error)]
pub enum PipelineError {
    /// A scan, label or calibration file.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// The classes or overlaps asked for.
    #[error(transparent)]
    Evaluate(#[from] EvaluateError),
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
    /// A frame that nobody labelled cannot be judged.
    #[error("frame {frame}: expected labels in {}, found no such file", path.display())]
    NoLabels {
        /// Name of the frame.
        frame: String,
        /// Where its labels should be.
        path: PathBuf,
    },
    /// A threshold can only be chosen where something unknown is labelled.
    #[error(
        "the data: expected labelled objects of the unknown classes ({}) that count at moderate, found none",
        if classes.is_empty() { "none named" } else { classes }
    )]
    NoUnknown {
        /// The unknown classes, with commas.
        classes: String,
    },
    /// No threshold keeps enough of the known.
    #[error(
        "the gate: expected a threshold that keeps nine tenths of the closed set's mAP ({closed:.2}), found none"
    )]
    NoThreshold {
        /// The closed set's mAP.
        closed: f64,
    },
    /// Somebody wrote the model file while it was judged.
    #[error(
        "{}: expected the file that was judged (fingerprint {expected:016x}), found another one (fingerprint {found:016x})",
        path.display()
    )]
    ModelChanged {
        /// The model file.
        path: PathBuf,
        /// Fingerprint of the model that was judged.
        expected: u64,
        /// Fingerprint of the file now.
        found: u64,
    },
    /// The system refused to write.
    #[error("{}: cannot be written: {cause}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's answer.
        cause: std::io::Error,
    },
}
