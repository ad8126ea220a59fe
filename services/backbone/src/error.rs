//! The errors of the backbone.

use mluc_model::ModelError;

pub(crate) type Result<T> = std::result::Result<T, BackboneError>;

/// The reason why the backbone cannot run.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // The message above each variant says what its fields are.
pub enum BackboneError {
    /// The model is refused.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// [`crate::Backbone::write_rows`] got room for another number of values.
    #[error("features: room for {expected} {what} needed, {found} given")]
    Room {
        what: &'static str,
        expected: usize,
        found: usize,
    },
    /// Int8 needs a calibration: how large the values of each layer get.
    #[error(
        "precision int8: a model with a calibration expected, found none; make one with `mluc-lab quantize --model FILE \
         --data DIR --out FILE`, or run this model in f32 or bf16"
    )]
    NotCalibrated,
}
