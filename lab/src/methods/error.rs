//! Why a method cannot run.

use crate::pipeline::PipelineError;
use mluc_model::HeadKind;
use mluc_refiner::RefinerError;

/// A model of another kind, or a stage.
#[derive(Debug, thiserror::Error)]
pub enum MethodError {
    /// The method stands on another kind of network.
    #[error("{method}: expected a model with a {expected:?} head, found a {found:?} head")]
    OtherHead {
        /// The method.
        method: &'static str,
        /// Its network's.
        expected: HeadKind,
        /// The model's.
        found: HeadKind,
    },
    /// OSIS without its point embedding.
    #[error("osis: expected a model with a point embedding, found none; osis-geo needs none")]
    NoEmbedding,
    /// A scan, or a stage.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    /// The refiner's settings, or the model's beams.
    #[error(transparent)]
    Refiner(#[from] RefinerError),
}
