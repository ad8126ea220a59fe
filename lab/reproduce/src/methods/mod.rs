//! The rows of the paper's tables (section 4.4), and ours: how each method uses the boxes that its network kept.
//!
//! [`run_method`] gives the objects of every frame at every threshold of a method; figures are computed elsewhere. A box is always unknown below the
//! threshold. The first threshold of a sweep is 0, at which no box is unknown: the closed set of that network.

mod dbscan;
mod full;
mod gated;
mod osis;
mod osis_embedding;
mod rows;

pub use full::full_steps;
pub use rows::{METHODS, Method, MethodRow};

use crate::Result;
use mluc_evaluate::pipeline::{DetectedFrame, FrameSet, GatedObjects};
use mluc_evaluate::pipeline::{ModelGate, THRESHOLDS, objects_at};
use mluc_model::Model;
use mluc_refiner::{Settings, Variant};

/// Input of a method.
#[derive(Clone, Copy)]
pub struct MethodInput<'a> {
    /// The network.
    pub model: &'a Model,
    /// The scans.
    pub set: &'a FrameSet,
    /// Result of [`mluc_evaluate::pipeline::detect_frames`] for the same model and scans.
    pub frames: &'a [DetectedFrame],
    /// Use exactly these thresholds (the first should be 0); `None`: 0 and a grid of quantiles.
    pub asked: Option<&'a [f64]>,
    /// Only for [`Method::MlucFull`]: the last step of [`full_steps`] that is included.
    pub full_step: usize,
    /// Called after each frame.
    pub step: &'a (dyn Fn() + Sync),
}

impl<'a> MethodInput<'a> {
    /// Input with the method's own thresholds and all of its parts.
    pub fn new(model: &'a Model, set: &'a FrameSet, frames: &'a [DetectedFrame]) -> Self {
        MethodInput { model, set, frames, asked: None, full_step: usize::MAX, step: &|| () }
    }

    /// 0, then at most `count` quantiles of the gate's values; or the requested thresholds.
    fn thresholds(&self, gate: ModelGate, frames: &[DetectedFrame], count: usize) -> Vec<f64> {
        let own = || gate.thresholds(frames, count);
        self.asked.map_or_else(own, <[f64]>::to_vec)
    }

    /// The refiner's published objects at every threshold of the gate.
    fn refined(
        &self,
        model: &Model,
        gate: ModelGate,
        frames: &[DetectedFrame],
        settings: &Settings,
    ) -> Result<GatedObjects> {
        let thresholds = self.thresholds(gate, frames, THRESHOLDS);
        let (set, step) = (self.set, self.step);
        objects_at(model, gate, set, frames, settings, thresholds, step)
    }
}

/// Runs a method and returns its objects at every threshold. The result does not depend on the number of threads.
pub fn run_method(method: Method, input: &MethodInput) -> Result<GatedObjects> {
    method.check(input.model)?;
    let refined =
        |gate, variant| input.refined(input.model, gate, input.frames, &Settings::of(variant));
    match method {
        // A class that counts as unknown is recognized by its name.
        Method::ClosedSet | Method::Supervised => {
            Ok(GatedObjects::ungated(input.model, input.frames))
        }
        Method::Naive => Ok(gated::as_they_are(input, ModelGate::Softmax)),
        Method::MlOnly => Ok(gated::as_they_are(input, ModelGate::Eds)),
        Method::UcOnly => refined(ModelGate::Softmax, Variant::Paper),
        Method::Paper => refined(ModelGate::Eds, Variant::Paper),
        Method::PaperCorrected | Method::MlucOpen => {
            refined(ModelGate::Eds, Variant::PaperCorrected)
        }
        Method::MlucFull => full::run(input),
        Method::Osis => osis::run(input, true),
        Method::OsisGeo => osis::run(input, false),
    }
}
