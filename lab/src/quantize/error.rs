//! Why a model gets no ranges.

use crate::dataset::DatasetError;
use mluc_backbone::BackboneError;
use mluc_head::HeadError;
use mluc_model::ModelError;

/// A model, a stage or the data.
#[derive(Debug, thiserror::Error)]
pub enum QuantizeError {
    /// A scan.
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
    /// No range can be chosen where no value was seen.
    #[error(
        "the data: expected scans with points inside the model's range, found {frames} frames that leave a layer at 0"
    )]
    NothingSeen {
        /// Frames that were run.
        frames: usize,
    },
}
