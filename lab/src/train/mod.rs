//! The trainer: labelled scans to a model file.
//!
//! No framework: the network is a fixed chain of convolution, batch norm and ReLU on lists of rows, its backward pass
//! is written by hand on the same kernels that drive the vehicle, and the bird's-eye part computes only the cells that
//! can differ from an empty scene ([`halo`]), which is exact.

pub mod augment;
mod backward;
mod check;
pub mod checkpoint;
pub mod clusters;
pub mod database;
pub mod embedding;
mod error;
pub mod export;
mod folder;
pub mod halo;
mod import;
pub mod layers;
pub mod loader;
mod log;
pub mod losses;
pub mod made_up;
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
pub mod random;
mod run;
pub mod scene;
mod settings;
pub mod source;
pub mod targets;
pub mod trainer;
#[cfg(test)]
mod trainer_tests;
mod validate;

pub use error::TrainError;
pub use log::Progress;
pub use osis::train_osis;
pub use run::{Event, Run};
pub use settings::{Improvements, Kind, Profile, Setting, Settings, hdl_64e};
pub use validate::{ClassFigures, Figures, validate};
