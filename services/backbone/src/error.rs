//! The errors of the backbone.

use mluc_model::ModelError;

pub(crate) type Result<T> = std::result::Result<T, BackboneError>;

/// The reason why the backbone cannot run.
#[derive(Debug, thiserror::Error)]
pub enum BackboneError {
    /// The model is refused.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// [`crate::Backbone::write_rows`] got room for another number of values: of what, needed, given.
    #[error("features: room for {1} {0} needed, {2} given")]
    Room(&'static str, usize, usize),
    /// Int8 needs a calibration: how large the values of each layer get.
    #[error(
        "precision int8: a model with a calibration expected, found none; make one with `mluc-lab quantize --model FILE \
         --data DIR --out FILE`, or run this model in f32 or bf16"
    )]
    NotCalibrated,
}
