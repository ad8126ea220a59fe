//! Why a file of weights is refused.

use mluc_backbone::BackboneError;
use mluc_head::HeadError;
use mluc_model::ModelError;

/// A fault in a checkpoint: what was expected, what was found.
#[derive(Debug, thiserror::Error)]
pub enum ExchangeError {
    /// Neither a PyTorch file nor safetensors.
    #[error(
        "the file: expected a PyTorch checkpoint (zip or legacy) or safetensors, found {bytes} bytes that begin with {head:02x?}"
    )]
    Unknown {
        /// Length of the file.
        bytes: usize,
        /// Its first bytes.
        head: Vec<u8>,
    },
    /// The zip archive or the safetensors header is damaged.
    #[error("the file is damaged or cut short: {cause}")]
    Container {
        /// What the reader said.
        cause: String,
    },
    /// A record of the archive.
    #[error("record {record}: expected {expected}, found {found}")]
    Record {
        /// Its name in the archive, or its storage key.
        record: String,
        /// In words.
        expected: String,
        /// In words.
        found: String,
    },
    /// The pickle wants to call something that a tensor does not need.
    #[error(
        "the pickle at byte {offset}: expected a global of tensors (torch._utils._rebuild_tensor_v2, torch.*Storage, \
         collections.OrderedDict, numpy scalars), found `{global}`: nothing was run; save the state_dict alone"
    )]
    Global {
        /// Byte of the pickle.
        offset: usize,
        /// `module.name`.
        global: String,
    },
    /// The pickle does something that a list of tensors does not.
    #[error("the pickle at byte {offset}: expected {expected}, found {found}")]
    Pickle {
        /// Byte of the pickle.
        offset: usize,
        /// In words.
        expected: &'static str,
        /// In words.
        found: String,
    },
    /// A pickle without a state_dict.
    #[error(
        "the checkpoint: expected a dictionary with model_state (name -> tensor), found {found}"
    )]
    NoState {
        /// In words.
        found: String,
    },
    /// A tensor whose numbers do not lie in its storage, or of a type that no weight has.
    #[error("tensor `{tensor}`: expected {expected}, found {found}")]
    Tensor {
        /// By its name in the checkpoint.
        tensor: String,
        /// In words.
        expected: String,
        /// In words.
        found: String,
    },
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
