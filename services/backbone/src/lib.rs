//! Points to bird's-eye features: voxels, sparse 3-D convolutions, bird's-eye convolutions (paper section 3.1).

pub mod bev;
mod rulebook;
mod rulebooks;
mod sites;
#[cfg(test)]
mod testing;
mod voxelize;

pub use rulebook::{gather, output_sites, rulebook};
pub use rulebooks::Rulebooks;
pub use sites::Sites;
pub use voxelize::{PointCounts, VOXEL_CHANNELS, Voxels, voxelize};
