//! The network as data, and the model file.
//!
//! [`Network`] describes every layer; the same description drives the trainer and the vehicle. [`Manifest`] says what
//! a model was trained for. Neither computes anything.

mod manifest;
mod network;
mod profiles;

pub use manifest::{AnchorClass, Beams, Manifest, Provenance, Thresholds};
pub use network::{DenseLayer, Grid, Network, SparseLayer, UpLayer};
