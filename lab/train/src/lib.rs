//! The trainer: from labelled scans to a model file.
//!
//! It uses no framework. The network is a fixed chain of convolution, batch norm and ReLU on lists of rows. Its backward pass is written by hand on
//! the same kernels as the vehicle's runtime. The bird's-eye part computes only the cells that can differ from an empty scene ([`halo`]), which is exact.

pub mod anchors;
pub mod augment;
mod backward;
pub mod batch_targets;
mod check;
pub mod checkpoint;
pub mod cluster_scorer;
pub mod database;
pub mod embedding;
mod error;
pub mod export;
pub mod halo;
mod import;
mod kind;
pub mod layers;
pub mod loader;
mod log;
pub mod losses;
pub mod mlp;
pub mod network;
#[cfg(test)]
mod network_tests;
pub mod norm;
pub mod optimizer;
mod osis;
#[cfg(test)]
mod parity_tests;
pub mod plan;
pub mod pool;
pub mod quantize;
mod run;
mod run_folder;
pub mod scan;
mod settings;
pub mod source;
pub mod stream;
pub mod synthetic_unknown;
pub mod targets;
#[cfg(test)]
mod testing;
pub mod thin;
pub mod trainer;
#[cfg(test)]
mod trainer_tests;

pub use check::check_known;
pub use error::TrainError;
pub use kind::{Architecture, NetworkKind, Setting};
pub use log::{Progress, TrainEvent};
pub use osis::train_osis;
pub use run::Run;
pub use run_folder::enter;
pub use settings::TrainSettings;
