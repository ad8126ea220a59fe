//! The refiner: from the head's candidates to unknown objects (paper section 3.3, unsupervised clustering).
//!
//! A candidate is a box whose class the network does not know, of a wrong class's size and up to a metre off. The
//! refiner finds the points that stand there, grows a cluster from a seed and lays a box around it; then it decides
//! which unknown objects stay beside each other and beside the known ones. Every candidate's fate is told.
//!
//! [`Refiner`] is the stage. [`cluster`] holds the ways to grow a cluster behind one trait, [`fit`] the ways to lay a
//! box. Nothing here reads a clock, a file or the environment; work is bounded by counting points, so that the same
//! input gives the same output on any machine. Candidates are refined one after the other: threads change nothing.
//!
//! Lengths in m, angles in rad, sensor frame: x forward, y left, z up.

mod angle;
mod ascending;
mod buckets;
mod candidate;
pub mod cluster;
mod draft;
mod error;
pub mod everything;
pub mod fit;
mod frame;
mod ground;
mod ground_map;
mod hull;
mod inside;
mod judge;
pub mod looks;
mod merge;
mod neighbourhood;
mod recipe;
mod refined;
mod refiner;
mod seed;
mod sensor;
mod settings;
mod settings_check;
mod size;
pub mod track;

pub use angle::{by_arctangent_rad, by_law_of_cosines_rad};
pub use error::RefinerError;
pub use everything::Everything;
pub use frame::{FrameIndex, IndexedPoint};
pub use ground::GroundPlane;
pub use ground_map::{GroundLabel, GroundMap};
pub use hull::HullSettings;
pub use looks::Looks;
pub use neighbourhood::{Gather, Neighbourhood};
pub use refined::{Counters, Refined};
pub use refiner::Refiner;
pub use sensor::{BeamTable, Sensor};
pub use settings::{
    CorrectedSettings, DistanceSettings, GroundSettings, LiteralSettings, MergeSettings, Mode,
    ReferenceSettings, Settings,
};
pub use track::{TrackSettings, Tracker};
