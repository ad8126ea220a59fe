//! Weights of others: checkpoints of OpenPCDet's SECOND become model files, and model files become safetensors with the
//! names that OpenPCDet gives its layers (`docs/weights.md` lists them).
//!
//! A PyTorch file holds a *pickle*, which is a program that may call anything. Nothing here runs it: [`pickle`] knows the
//! few calls that a tensor needs and refuses every other by name.

pub mod checkpoint;
mod error;
mod export;
mod import;
mod names;
pub mod pickle;
mod sparse;

pub use error::ExchangeError;
pub use export::export;
pub use import::{ImportRequest, Imported, import};
pub use names::{openpcdet_name, tensor_names};
pub use sparse::SparseLayout;
