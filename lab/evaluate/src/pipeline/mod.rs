//! The whole pipeline in one process, without the runtime: the vehicle's computation, evaluated against labels.
//!
//! Detections do not depend on the gate's threshold, so [`detect_frames`] runs backbone and head once per frame, [`objects_at`] the
//! refiner at any thresholds of a [`ModelGate`], and [`judge`] and [`sweep_gate`] evaluate the objects.
//! [`choose_threshold`] follows the paper's rule (section 4.3), [`choose_profiles`] a limit on false objects. [`write_threshold`] and
//! [`write_profiles`] write the choice into the model file, with how it was made.

mod frames;
mod gate;
mod judge;
mod parts;
mod separation;
mod stages;

pub(crate) use crate::rings::finite_points;
pub use crate::rule::{paper_rules, unknown_classes};
pub use frames::{DetectedFrame, FrameSet, folder_tail, scan_points};
pub use gate::{ModelGate, THRESHOLDS};
pub use judge::{
    Choice, ModelJudgement, ScoreChoice, choose_profiles, choose_threshold, judge, sweep_gate,
    write_precisions, write_profiles, write_threshold,
};
pub use parts::{read_parts, write_part};
pub use separation::{ScoreSeparation, separation};
pub use stages::{GatedObjects, box_of, detect_frames, objects_at};
