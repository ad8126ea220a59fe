//! Why a file of weights is refused.

use mluc_backbone::BackboneError;
use mluc_head::HeadError;
use mluc_model::ModelError;

/// A fault in a checkpoint: what was expected, what was found.
#[derive(Debug, thiserror::Error)]
pub enum ExchangeError {
    /// A file of PyTorch itself.
    #[error(
        "expected safetensors, found a PyTorch checkpoint; convert it with \
         `python tools/checkpoint_to_safetensors.py CHECKPOINT.pth CHECKPOINT.safetensors`"
    )]
    PyTorch,
    /// No safetensors, or damaged.
    #[error("expected safetensors, found {bytes} bytes that are none or are cut short: {cause}")]
    Container {
        /// Length of the file.
        bytes: usize,
        /// What the reader said.
        cause: String,
    },
    /// The metadata's manifest cannot be read or written.
    #[error("the manifest in the file's metadata: {0}")]
    Manifest(#[from] serde_json::Error),
    /// The export cannot be made.
    #[error("the safetensors cannot be made: {0}")]
    Written(safetensors::SafeTensorError),
    /// A tensor that the network needs.
    #[error(
        "tensor `{tensor}` of shape {expected:?} is missing: is the checkpoint of SECOND with {classes} classes?"
    )]
    Missing {
        /// By its name in the checkpoint.
        tensor: String,
        /// Its shape.
        expected: Vec<usize>,
        /// Of the model to be made.
        classes: usize,
    },
    /// A tensor of another shape.
    #[error("tensor `{tensor}`: expected shape {expected}, found {found:?}")]
    Shape {
        /// By its name in the checkpoint.
        tensor: String,
        /// One shape, or several where several layouts are read.
        expected: String,
        /// In the file.
        found: Vec<usize>,
    },
    /// A tensor that SECOND does not have.
    #[error(
        "tensor `{tensor}`{}: expected a layer of SECOND, found none of that name",
        others_note(*others)
    )]
    Extra {
        /// The first such name.
        tensor: String,
        /// How many more there are.
        others: usize,
    },
    /// A class without anchors.
    #[error(
        "class {class}: expected its anchor (name=length,width,height,bottom in m), found none"
    )]
    NoAnchor {
        /// The class.
        class: String,
    },
    /// The model that came out.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// Its backbone.
    #[error(transparent)]
    Backbone(#[from] BackboneError),
    /// Its head.
    #[error(transparent)]
    Head(#[from] HeadError),
}

fn others_note(others: usize) -> String {
    match others {
        0 => String::new(),
        count => format!(" and {count} more"),
    }
}
