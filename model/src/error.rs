//! The errors of a model.

use std::{fmt::Display, path::PathBuf};

pub(crate) type Result<T> = std::result::Result<T, ModelError>;

/// The reason why a model is refused: the field or tensor, the expected and the found value.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// An error and the file in which it is.
    #[error("{0}: {1}")]
    InFile(PathBuf, Box<ModelError>),
    /// The bytes are not a safetensors file with a manifest of this format.
    #[error("model file {0}")]
    File(String),
    /// The manifest is not JSON with the expected fields; the text names field, line and column.
    #[error("manifest: {0}")]
    Syntax(#[from] serde_json::Error),
    /// A field of the manifest is out of its bounds: for instance `network.grid.voxel_size_m[0]`.
    #[error("manifest: {0} must be {1}, found {2}")]
    Field(String, String, String),
    /// A tensor is missing or unknown, has another shape or type, or has a value that is out of its bounds.
    #[error("weights: tensor `{0}` {1}")]
    Tensor(String, String),
    /// A sensor profile cannot be read or is out of its bounds.
    #[error("sensor profile {0}: {1}")]
    Sensor(String, String),
    /// The file cannot be read.
    #[error("model file {0}: {1}")]
    Io(PathBuf, std::io::Error),
}

impl ModelError {
    pub(crate) fn sensor(place: &str, cause: String) -> ModelError {
        ModelError::Sensor(place.into(), cause)
    }

    pub(crate) fn tensor(tensor: &str, cause: impl Display) -> ModelError {
        ModelError::Tensor(tensor.into(), cause.to_string())
    }
}
