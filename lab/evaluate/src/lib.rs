//! Quality of detections: average precision as the KITTI object devkit computes it, and open-set figures.
//!
//! Source: KITTI's object development kit (Geiger, Lenz, Urtasun, CVPR 2012), the offline version with 41 recall positions; the open-set figures (recall and AP
//! of the unknown, mAP of the known, their harmonic mean, the choice of the threshold) from the paper "Open-set 3D Object Detection", section 4.
//!
//! A [`LabelledFrame`] has the labels and the detections of a frame, both in the camera frame. A [`ClassRule`] says which labels count, which are ignored
//! and which overlap is required. Both give a curve of precision over recall, from which AP at 11 positions, at 40 positions and over all points follow.
//! [`evaluate`] does this for every class, metric and difficulty, [`Breakdown`] by range and by the sensor's rings on the object, [`JudgedPoint`] for a
//! threshold of the gate. [`Operating`] gives the false objects and the recall at a score. [`Tracks`] counts a tracked object once.
//!
//! Frames are matched one by one, so the open-set figures of any part of a data set follow without another matching.
//! [`JudgedFrames`] keeps the parts. A [`JudgedPoint`] evaluates the halves of the data as well as the whole. [`honest`] chooses on one half
//! and reports on the other. [`JudgedFrames::bootstrap`] resamples frames and gives the uncertainty of a figure.

mod breakdown;
mod curve;
mod difficulty;
mod error;
mod frame;
pub mod input;
mod matching;
mod open_set;
mod operating;
mod paired;
pub mod pipeline;
mod report;
mod rings;
mod rule;
mod sweep;
#[cfg(test)]
mod tests;
mod tracks;

pub use breakdown::Breakdown;
pub use curve::{AveragePrecision, harmonic_mean};
pub use difficulty::Difficulty;
pub(crate) use difficulty::Metric;
pub use error::{EvaluateError, Result};
pub use frame::{FrameTruth, LabelledFrame, SensorDetection};
pub use mluc_ipc_types::ObjectKind;
pub use open_set::{ClassPrecision, JudgedFrames, OpenSetFigures};
pub use operating::Operating;
pub use paired::paired;
pub use report::{ApEntry, ApReport, ClassReport, evaluate, render};
pub use rings::FrameRings;
pub use rule::{
    ClassRule, RuleRequest, UNKNOWN_IOUS, UnknownProtocol, rules, unevaluated, unrecognized,
};
pub use sweep::{Honest, JudgedPoint, KNOWN_KEPT_MIN, SweepPoint, best_index, honest};
pub use tracks::Tracks;

/// Name of the class into which all unknown classes are merged.
pub const UNKNOWN: &str = "unknown";
