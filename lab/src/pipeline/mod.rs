//! The whole pipeline in one process, without the runtime: what the vehicle computes, judged against labels.
//!
//! A scan goes through the stage libraries one after the other: [`Detector`] is the backbone and the head,
//! [`ObjectFinder`] the gate at any threshold and the refiner, [`Pipeline`] both. Detections do not depend on the
//! gate's threshold, so [`detect_frames`] runs the network once a frame, and [`judge`] and [`sweep_gate`] work on what
//! it kept. [`choose_threshold`] follows the paper's rule (section 4.3); [`write_threshold`] puts the choice into the
//! model file, with how it was made.

mod choice;
mod error;
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
pub use error::PipelineError;
pub use frames::{DetectedFrame, FrameSet, scan_points};
pub use gate::Gate;
pub use judge::{Judgement, judge};
pub use misses::{AlarmRow, MissRow, MissTable, misses};
pub use rules::{known_iou_min, unknown_classes};
pub use separation::{ScoreSeparation, separation};
pub(crate) use stages::class_names;
pub use stages::{Detector, FoundObject, ObjectFinder, Pipeline, detect_frames, detect_frames_in};
pub(crate) use sweep::objects_at;
pub use sweep::{GateSweep, THRESHOLDS, sweep_gate};
