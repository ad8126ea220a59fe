//! What can be wrong with a model.

use std::{fmt::Display, path::PathBuf};

pub(crate) type Result<T> = std::result::Result<T, ModelError>;

/// Why a model is refused: which field or tensor, what was expected, what was found.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// What is wrong, and in which file.
    #[error("{0}: {1}")]
    InFile(PathBuf, Box<ModelError>),
    /// The bytes are no safetensors file with a manifest of this format.
    #[error("model file {0}")]
    File(String),
    /// The manifest is no JSON of the expected fields; says field, line and column.
    #[error("manifest: {0}")]
    Syntax(#[from] serde_json::Error),
    /// A field of the manifest out of its bounds: `network.grid.voxel_size_m[0]` for instance.
    #[error("manifest: {0} must be {1}, found {2}")]
    Field(String, String, String),
    /// A tensor that is missing or unknown, of another shape or type, or with a value that is out of its bounds.
    #[error("weights: tensor `{0}` {1}")]
    Tensor(String, String),
    /// A sensor profile that cannot be read or is out of its bounds.
    #[error("sensor profile {0}: {1}")]
    Sensor(String, String),
    /// Reading the file.
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
