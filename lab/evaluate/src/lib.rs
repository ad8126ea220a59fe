//! How good detections are: average precision as the KITTI object devkit computes it, and its open-set companions.
//!
//! Source: KITTI's object development kit (Geiger, Lenz, Urtasun, CVPR 2012), the offline version with 41 recall positions; the open-set figures (recall and AP
//! of the unknown, mAP of the known, their harmonic mean, the choice of the threshold) from the paper "Open-set 3D Object Detection", section 4.
//!
//! A [`LabelledFrame`] holds what was labelled and what was found, both in the camera frame. A [`ClassRule`] says which labels count, which are ignored and how
//! much overlap is asked for. Both give a curve of precision over recall, from which AP at 11 positions, at 40 positions and over all points follow;
//! [`evaluate`] does so for every class, metric and difficulty, [`Breakdown`] by range and by the sensor's rings on the object; [`JudgedPoint`] for a threshold
//! of the gate. [`Operating`] says what a robot gets at a score, [`Tracks`] counts an object that is followed once.
//!
//! Frames are matched one by one, so the open-set figures of any part of a data set follow without matching again:
//! [`JudgedFrames`] keeps the parts, a [`JudgedPoint`] judges halves of the data beside the whole, [`honest`] chooses on one half
//! and reports on the other, [`JudgedFrames::bootstrap`] draws frames anew to say how far a figure can be trusted.

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
pub use open_set::{ClassPrecision, JudgedFrames, OpenSetFigures, UNKNOWN_IOUS};
pub use operating::Operating;
pub use paired::paired;
pub use report::{ApEntry, ApReport, ClassReport, evaluate, render};
pub use rings::FrameRings;
pub use rule::{
    ClassRule, RuleRequest, UNKNOWN, UnknownProtocol, rules, unevaluated, unrecognized,
};
pub use sweep::{Honest, JudgedPoint, KNOWN_KEPT_MIN, SweepPoint, best_index, honest};
pub use tracks::Tracks;
