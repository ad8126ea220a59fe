//! Weights of others: checkpoints of OpenPCDet's SECOND become model files (`docs/weights.md` lists the names of its layers).
//!
//! A checkpoint comes as safetensors. PyTorch's own files hold a pickle, a program that may call anything:
//! `tools/checkpoint_to_safetensors.py` converts them with PyTorch's restricted reader.

mod checkpoint;
mod import;
mod names;

pub use import::{Imported, SparseLayout, anchor, import, second};
pub use names::tensor_names;
