//! A model's figures at its own threshold and without the gate.

use super::misses::{MissTable, labels_that_count, misses};
use super::rules::paper_rules;
use super::separation::{ScoreSeparation, separation};
use super::stages::class_names;
use super::sweep::objects_at;
use super::{DetectedFrame, FrameSet, ModelGate};
use crate::{
    ApReport, ClassRule, EvaluateError, LabelledFrame, NeighbourPolicy, ObjectKind, evaluate,
    unknown_as_known,
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
    /// Unknown labels that count.
    pub unknown_labels: usize,
    /// Unknown labels that a known object lies on (absolute open-set error), without the gate.
    pub unknown_as_known_closed: usize,
    /// The same at the model's threshold.
    pub unknown_as_known: usize,
    /// What became of each label without the gate, by class.
    pub misses: Vec<MissTable>,
    /// Boxes that the network kept.
    pub boxes: usize,
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
    let threshold = ModelGate::of(model).threshold(&model.manifest.thresholds);
    let objects = objects_at(model, set, frames, settings, &[0.0, threshold], &|| ())?;
    let frames_at = |at: usize| -> Vec<LabelledFrame> {
        let pairs = frames.iter().zip(&objects).map(|(frame, found)| {
            let objects: Vec<_> = found[at].iter().map(|o| o.to_detection(&classes)).collect();
            frame.truth.with(&objects)
        });
        pairs.collect()
    };
    let (closed, gated) = (frames_at(0), frames_at(1));
    let labels = frames
        .iter()
        .flat_map(|f| labels_that_count(&f.truth.labels, &rules));
    let unknown = labels.filter(|(_, rule)| rule.kind == ObjectKind::Unknown);
    Ok(ModelJudgement {
        closed: evaluate(&closed, &rules),
        gated: evaluate(&gated, &rules),
        threshold,
        separation: separation(frames, &rules),
        unknown_labels: unknown.count(),
        unknown_as_known_closed: unknown_as_known(&closed, &rules),
        unknown_as_known: unknown_as_known(&gated, &rules),
        misses: misses(&closed, &rules),
        boxes: frames.iter().map(|frame| frame.detections.len()).sum(),
        rules,
    })
}
