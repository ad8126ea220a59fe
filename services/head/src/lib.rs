//! Feature rows to detections: objectness, boxes, distances to the prototypes, the gate (paper section 3.2).
//!
//! [`Head`] is the stage; [`decode`], [`prototypes`] and [`gate`] hold its equations. One embedding a cell serves all of
//! its anchors: an anchor is only ever positive for its own class, so an embedding of its own would learn that class and
//! nothing else. Nothing here knows a process, a file or a clock.

mod candidates;
mod convolutions;
pub mod decode;
pub mod gate;
mod head;
mod memory;
pub mod prototypes;
mod report;

pub use head::{Head, stand_on_ground};
pub use mluc_ipc_types::{Detection, DetectionKind};
pub use report::{HeadCounts, HeadError};

// Whatever a checked model gives fits the contract.
const _: () = assert!(mluc_model::CLASSES_MAX <= mluc_ipc_types::CLASSES_MAX);
const _: () = assert!(mluc_model::BOXES_MAX as usize <= mluc_ipc_types::DETECTIONS_MAX);
