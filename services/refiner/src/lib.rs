//! The refiner: from the head's candidates to unknown objects (paper section 3.3, unsupervised clustering).
//!
//! A candidate is a box whose class the network does not know; it has a wrong class's size and is up to a metre off. The
//! refiner finds ground and clusters of the scan, matches each candidate to a cluster, fits a box around it, scores it, and
//! decides which overlapping unknown and known objects are kept. Every candidate gets a disposition.
//!
//! [`Refiner`] is the stage; `decide.rs` decides what is unknown and why. [`clusters`] finds the clusters of a scan. [`paper`] contains the paper's
//! variants, which grow a cluster for each candidate. [`fit`] contains the ways to fit a box. Nothing here reads a clock, a file or the environment;
//! counting points bounds the work, so that the same input gives the same output on any machine.
//!
//! Lengths in m, angles in rad, sensor frame: x forward, y left, z up.

pub mod cluster_scorer;
mod clusterer;
pub mod clusters;
mod decide;
mod ego;
pub mod fit;
mod frame;
mod merge;
mod output;
pub mod paper;
mod priors;
mod proposal;
mod refiner;
mod sensor;
mod settings;
mod size;
#[cfg(test)]
mod testing;
pub mod track;

pub use cluster_scorer::ClusterScorer;
pub use ego::EgoEstimator;
pub use frame::{FrameIndex, IndexedPoint};
pub use output::{Counters, RefinerOutput};
pub use refiner::{Refiner, WORK_MAX};
pub use sensor::Sensor;
pub use settings::{RefinerError, RobotSettings, Settings, Study, Variant};
pub use track::{TrackSettings, Tracker};
