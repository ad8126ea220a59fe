//! The whole pipeline in one process, without the runtime: what the vehicle computes, judged against labels.
//!
//! A scan goes through the stage libraries one after the other: [`Detector`] is the backbone and the head,
//! [`ObjectFinder`] the gate at any threshold and the refiner, [`Pipeline`] both. Detections do not depend on the
//! gate's threshold, so [`detect_frames`] runs the network once a frame, and [`judge`] and [`sweep_gate`] work on what
//! it kept. [`choose_threshold`] follows the paper's rule (section 4.3); [`write_threshold`] puts the choice into the
//! model file, with how it was made.

mod choice;
mod frames;
mod gate;
mod judge;
mod mahalanobis;
mod misses;
mod rules;
mod separation;
mod stages;
mod sweep;

pub use choice::{Choice, choose_threshold, write_threshold};
pub use frames::{DetectedFrame, FrameSet, scan_points};
pub use gate::ModelGate;
pub use judge::{ModelJudgement, judge};
pub use misses::{AlarmRow, MissRow, MissTable, misses};
pub use rules::{known_iou_min, paper_rules, unknown_classes};
pub use separation::{ScoreSeparation, separation};
pub use stages::{
    Detector, FoundObject, ObjectFinder, Pipeline, class_names, detect_frames, detect_frames_in,
};
pub use sweep::{GateSweep, THRESHOLDS, objects_at, over_frames, sweep_gate};
