//! The rows of the paper's tables (section 4.4), and ours: what each makes of the boxes that its network kept.
//!
//! [`run_method`] gives the objects of every frame at every threshold of a method; figures are made of them elsewhere. A
//! threshold is always one below which a box is held for unknown; the first of a sweep is 0, where nothing is: the closed
//! set of that network.

mod dbscan;
mod full;
mod gated;
mod osis;
mod osis_embedding;
mod rows;

pub use full::{FullSettings, full_steps};
pub use rows::{METHODS, Method, MethodRow, PaperFigures};

use crate::ReproduceError;
use gated::UnknownScore;
use mluc_evaluate::pipeline::{DetectedFrame, FoundObject, FrameSet, THRESHOLDS, class_names};
use mluc_evaluate::{SensorDetection, quantile_grid};
use mluc_model::Model;
use mluc_refiner::Variant;

/// What a method works on.
#[derive(Clone, Copy)]
pub struct MethodInput<'a> {
    /// The network.
    pub model: &'a Model,
    /// The scans.
    pub set: &'a FrameSet,
    /// [`mluc_evaluate::pipeline::detect_frames`] of the same model and scans.
    pub frames: &'a [DetectedFrame],
    /// Exactly these thresholds (the first should be 0); `None`: 0 and a grid of [`THRESHOLDS`] quantiles.
    pub thresholds: Option<&'a [f64]>,
    /// Of [`Method::MlucFull`] alone.
    pub full: FullSettings,
    /// Called after each frame.
    pub step: &'a (dyn Fn() + Sync),
}

impl<'a> MethodInput<'a> {
    /// With the method's own thresholds and every part of it.
    pub fn new(model: &'a Model, set: &'a FrameSet, frames: &'a [DetectedFrame]) -> Self {
        MethodInput {
            model,
            set,
            frames,
            thresholds: None,
            full: FullSettings::default(),
            step: &|| (),
        }
    }

    /// 0, then at most `count` quantiles of `values`; or what was asked for.
    fn thresholds_over(&self, values: impl Iterator<Item = f32>, count: usize) -> Vec<f64> {
        if let Some(asked) = self.thresholds {
            return asked.to_vec();
        }
        let values: Vec<f64> = values.map(f64::from).collect();
        let grid = quantile_grid(&values, count.min(THRESHOLDS));
        [0.0].into_iter().chain(grid).collect()
    }

    /// Every kept box of every frame.
    fn boxes(&self) -> impl Iterator<Item = &'a mluc_head::Detection> {
        self.frames.iter().flat_map(|frame| &frame.detections)
    }
}

/// Objects at every threshold.
#[derive(Clone, Debug)]
pub struct MethodOutput {
    /// Thresholds; the first is the closed set.
    pub thresholds: Vec<f64>,
    /// Objects by frame, then by threshold.
    pub objects: Vec<Vec<Vec<FoundObject>>>,
    /// Classes that the objects count by.
    pub classes: Vec<String>,
}

impl MethodOutput {
    /// What is found in a frame at the threshold of index `at`.
    pub fn detections(&self, frame: usize, at: usize) -> Vec<SensorDetection> {
        let objects = self.objects[frame][at].iter();
        objects.map(|o| o.to_detection(&self.classes)).collect()
    }
}

/// Thresholds, and objects by frame and threshold.
type Swept = (Vec<f64>, Vec<Vec<Vec<FoundObject>>>);

/// Runs a method. The result does not depend on the number of threads.
pub fn run_method(method: Method, input: &MethodInput) -> Result<MethodOutput, ReproduceError> {
    method.check(input.model)?;
    let (thresholds, objects) = match method {
        Method::ClosedSet | Method::Supervised => gated::all_known(input),
        Method::Naive => gated::as_they_are(input, UnknownScore::Msp),
        Method::MlOnly => gated::as_they_are(input, UnknownScore::Eds),
        Method::UcOnly => gated::refined(input, UnknownScore::Msp, Variant::Paper)?,
        Method::Paper => gated::refined(input, UnknownScore::Eds, Variant::Paper)?,
        Method::PaperCorrected | Method::MlucOpen => {
            gated::refined(input, UnknownScore::Eds, Variant::PaperCorrected)?
        }
        Method::MlucFull => full::run(input)?,
        Method::Osis => osis::run(input, true)?,
        Method::OsisGeo => osis::run(input, false)?,
    };
    Ok(MethodOutput {
        thresholds,
        objects,
        classes: class_names(input.model),
    })
}
