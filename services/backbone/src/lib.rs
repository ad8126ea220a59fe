//! Points to bird's-eye feature rows: voxels, sparse 3-D convolutions, bird's-eye convolutions (paper section 3.1).
//!
//! [`Backbone`] is the stage. The trainer shares its parts ([`voxelize`], [`Rulebooks`]). Nothing here uses a process, a file or a clock.

mod auto;
mod backbone;
mod cells;
mod convolution;
mod error;
mod features;
mod layers;
mod plane;
mod precision;
mod quant_scale;
mod rulebook;
mod rulebooks;
mod sites;
mod sparse;
#[cfg(test)]
mod testing;
mod trace;
mod voxelize;
mod warm_up;

pub use backbone::Backbone;
pub use error::BackboneError;
pub use layers::Frame;
pub use plane::Coverage;
pub use precision::Precision;
pub use rulebooks::Rulebooks;
pub use sites::Sites;
pub use trace::{Level, Observer, Place, Step, Steps};
pub use voxelize::{NEAREST_SQUARED, PointCounts, VOXEL_CHANNELS, Voxels, localize, voxelize};

// The limits of a checked model fit the limits of the contract.
const _: () = assert!(mluc_model::MAP_CELLS_MAX <= mluc_ipc_types::CELLS_MAX);
const _: () = assert!(mluc_model::FEATURE_CHANNELS_MAX <= mluc_ipc_types::FEATURE_CHANNELS_MAX);
const _: () = assert!(mluc_model::CLASS_NAME_MAX <= mluc_ipc_types::CLASS_NAME_MAX);
const _: () = assert!(mluc_model::VOXELS_MAX as usize <= mluc_ipc_types::POINTS_MAX);
