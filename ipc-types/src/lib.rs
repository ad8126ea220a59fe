//! The contract: all that crosses the border between two processes, and nothing else.
//!
//! Every message is a slice of fixed-layout elements with one [`FrameHeader`]. Lengths in m, angles in rad, times in ns. A consumer trusts nothing that it
//! reads from shared memory: the `checked` functions turn a wrong version, length, index or enum value into a [`ContractError`], never a panic.

mod detection;
mod error;
mod features;
mod header;
mod health;
mod limits;
mod object;
mod point;
mod run;
mod services;
mod status;
mod text;

pub use detection::{Detection, DetectionKind, GateKind, NO_PROBABILITY};
pub use error::ContractError;
pub use features::{FeatureBlock, FeatureRows, feature_blocks};
pub use header::{EgoPose, Flags, FrameHeader, Stage, StageStamps};
pub use health::{CandidateCounts, Health, HealthState};
pub use limits::*;
pub use object::{Disposition, Object, ObjectKind, TrackNews};
pub use point::Point;
pub use run::RunDescription;
pub use services::Topic;
pub use status::{Status, StatusState};
pub use text::Text;
