//! What can be wrong with a model.

/// Why a model is refused: which field or tensor, what was expected, what was found.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// What is wrong, and in which file.
    #[error("{}: {cause}", path.display())]
    InFile {
        /// The file.
        path: std::path::PathBuf,
        /// What is wrong with it.
        cause: Box<ModelError>,
    },
    /// The bytes are no whole safetensors file.
    #[error("model file of {bytes} bytes is damaged or cut short: {cause}")]
    Container {
        /// Length of the file.
        bytes: usize,
        /// What the reader said.
        cause: String,
    },
    /// Metadata without our manifest.
    #[error("model file has no manifest (metadata key `{key}`)")]
    NoManifest {
        /// The key looked for.
        key: &'static str,
    },
    /// Another version of the format.
    #[error(
        "model file has format {found}, this program reads format {expected}: train it again or convert it"
    )]
    Format {
        /// [`crate::Manifest::FORMAT`].
        expected: u32,
        /// In the file.
        found: String,
    },
    /// The manifest is no JSON of the expected fields.
    #[error("manifest: {cause}")]
    ManifestSyntax {
        /// Field, line and column.
        cause: String,
    },
    /// A field of the manifest out of its bounds.
    #[error("manifest: {field} must be {expected}, found {found}")]
    Field {
        /// Path of the field, `network.grid.voxel_size_m[0]` for instance.
        field: String,
        /// Allowed values in words.
        expected: String,
        /// The value.
        found: String,
    },
    /// A tensor that the network needs.
    #[error("weights: tensor `{tensor}` of shape {expected:?} is missing")]
    TensorMissing {
        /// Its name.
        tensor: String,
        /// Its shape.
        expected: Vec<usize>,
    },
    /// A tensor that the network does not have.
    #[error("weights: tensor `{tensor}` does not belong to this network")]
    TensorUnknown {
        /// Its name.
        tensor: String,
    },
    /// A tensor of another shape.
    #[error("weights: tensor `{tensor}` must have shape {expected:?}, found {found:?}")]
    TensorShape {
        /// Its name.
        tensor: String,
        /// By the network.
        expected: Vec<usize>,
        /// In the file.
        found: Vec<usize>,
    },
    /// A tensor of another element type.
    #[error("weights: tensor `{tensor}` must hold F32, found {found}")]
    TensorType {
        /// Its name.
        tensor: String,
        /// In the file.
        found: String,
    },
    /// NaN, infinity, or a variance below 0.
    #[error("weights: tensor `{tensor}`, element {index}: must be {expected}, found {found}")]
    TensorValue {
        /// Its name.
        tensor: String,
        /// Row-major.
        index: usize,
        /// Allowed values in words.
        expected: &'static str,
        /// The value.
        found: f32,
    },
    /// Reading the file.
    #[error("model file {path}: {cause}")]
    Io {
        /// Which file.
        path: std::path::PathBuf,
        /// What the system said.
        cause: std::io::Error,
    },
}
