//! Weights of others: checkpoints of OpenPCDet's SECOND become model files, and model files become safetensors with the
//! names that OpenPCDet gives its layers (`docs/weights.md` lists them).
//!
//! A checkpoint comes as safetensors. PyTorch's own files hold a pickle, a program that may call anything:
//! `tools/checkpoint_to_safetensors.py` converts them with PyTorch's restricted reader.

mod checkpoint;
mod export;
mod import;
mod names;
mod sparse;

pub use export::export;
pub use import::{Imported, anchor, import, second};
pub use names::{openpcdet_name, tensor_names};
pub use sparse::SparseLayout;
