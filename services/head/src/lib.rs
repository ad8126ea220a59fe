//! Feature rows to detections: objectness, boxes, distances to the prototypes, the gate (paper section 3.2).
//!
//! [`Head`] is the stage; [`decode`], [`prototypes`] and [`gate`] contain its equations. All anchors of a cell share one embedding: an anchor is only
//! positive for its own class, so an embedding per anchor would only learn that class. Nothing here uses a process, a file or a clock.

mod candidates;
mod convolutions;
pub mod decode;
pub mod gate;
mod head;
mod memory;
pub mod prototypes;
mod vote;

pub use head::{Head, stand_on_ground};
pub use mluc_ipc_types::{Detection, DetectionKind};

// The limits of a checked model fit the limits of the contract.
const _: () = assert!(mluc_model::CLASSES_MAX <= mluc_ipc_types::CLASSES_MAX);
const _: () = assert!(mluc_model::BOXES_MAX as usize <= mluc_ipc_types::DETECTIONS_MAX);

/// The reason why the head cannot run.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // The message above each variant says what its fields are.
pub enum HeadError {
    /// The model is refused.
    #[error(transparent)]
    Model(#[from] mluc_model::ModelError),
    /// Cells without a feature row would contain candidates that the head does not evaluate.
    #[error(
        "model: an empty scene reaches objectness {empty_objectness_max}, which must be below objectness_min \
         {objectness_min}: raise the threshold or train further"
    )]
    FiresOnNothing { empty_objectness_max: f32, objectness_min: f32 },
    /// The lengths of cells and rows do not match.
    #[error("features: {expected} values for {cells} cells needed, {found} given")]
    Length { cells: usize, expected: usize, found: usize },
    /// A cell beyond the map.
    #[error("features: cells must be below {expected}, found {found}")]
    Cell { expected: usize, found: u32 },
}

/// The counts of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HeadCounts {
    /// Anchors at or above `objectness_min`.
    pub candidates: u32,
    /// Candidates left out because they exceed `candidates_max`.
    pub over_candidates_max: u32,
    /// Anchors left out because their objectness, box, embedding or logit of the unknown is NaN or too large.
    pub non_finite: u32,
    /// Whether `boxes_max` was reached: weaker boxes may have been left out.
    pub boxes_max_reached: bool,
}
