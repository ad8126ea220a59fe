//! A model's figures at its own threshold, without the gate, and at many thresholds.

use super::misses::{MissTable, misses};
use super::separation::{ScoreSeparation, separation};
use super::{DetectedFrame, FrameSet, ModelGate, THRESHOLDS, class_names, objects_at, paper_rules};
use crate::open_set::unknown_as_known;
use crate::{
    ApReport, ClassRule, EvaluateError, JudgedPoint, NeighbourPolicy, SweepPoint, evaluate,
};
use mluc_model::Model;
use mluc_refiner::Settings;

/// Everything about a model except the sweep.
#[derive(Clone, Debug)]
pub struct ModelJudgement {
    /// How each class was judged.
    pub rules: Vec<ClassRule>,
    /// All boxes known.
    pub closed: ApReport,
    /// At the model's threshold.
    pub gated: ApReport,
    /// The model's threshold as [`ModelGate`] has it; 0 where none was chosen.
    pub threshold: f32,
    /// Unknown from known, by score.
    pub separation: Vec<ScoreSeparation>,
    /// Unknown labels that a known object lies on (absolute open-set error), without the gate.
    pub unknown_as_known_closed: usize,
    /// The same at the model's threshold.
    pub unknown_as_known: usize,
    /// What became of each label without the gate, by class.
    pub misses: Vec<MissTable>,
    /// Boxes that the network kept.
    pub boxes: usize,
}

impl ModelJudgement {
    /// Unknown labels that count.
    pub fn unknown_labels(&self) -> usize {
        let unknown = self.gated.unknown();
        unknown.map_or(0, |class| class.main().truth_count)
    }
}

/// Judges the detections of a set; `unknown` are the label classes that count as unknown.
pub fn judge(
    model: &Model,
    set: &FrameSet,
    frames: &[DetectedFrame],
    unknown: &[String],
    neighbours: NeighbourPolicy,
    settings: &Settings,
) -> Result<ModelJudgement, EvaluateError> {
    let classes = class_names(model);
    let rules = paper_rules(&model.manifest.name, &classes, unknown, neighbours)?;
    let gate = ModelGate::of(model);
    let threshold = gate.threshold(&model.manifest.thresholds);
    let asked = vec![0.0, f64::from(threshold)];
    let objects = objects_at(model, gate, set, frames, settings, asked, &|| ())?;
    let [closed, gated] = [0, 1].map(|at| objects.labelled(frames, at));
    Ok(ModelJudgement {
        closed: evaluate(&closed, &rules),
        gated: evaluate(&gated, &rules),
        threshold,
        separation: separation(frames, &rules),
        unknown_as_known_closed: unknown_as_known(&closed, &rules),
        unknown_as_known: unknown_as_known(&gated, &rules),
        misses: misses(&closed, &rules),
        boxes: frames.iter().map(|frame| frame.detections.len()).sum(),
        rules,
    })
}

/// The figures of the closed set, then those of [`THRESHOLDS`] thresholds of the model's gate, ascending. Every frame is refined at
/// every one (`step` is called after each frame).
pub fn sweep_gate(
    model: &Model,
    set: &FrameSet,
    frames: &[DetectedFrame],
    rules: &[ClassRule],
    settings: &Settings,
    step: &(dyn Fn() + Sync),
) -> Result<Vec<SweepPoint>, EvaluateError> {
    let gate = ModelGate::of(model);
    let thresholds = gate.thresholds(frames, THRESHOLDS);
    let objects = objects_at(model, gate, set, frames, settings, thresholds, step)?;
    let points = objects.sweep(frames, rules);
    Ok(points.iter().map(JudgedPoint::main).collect())
}
