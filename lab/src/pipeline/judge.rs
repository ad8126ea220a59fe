//! A model's figures at its own threshold and without the gate.

use super::rules::class_rules;
use super::separation::labels_that_count;
use super::stages::class_names;
use super::sweep::objects_at;
use super::{
    DetectedFrame, FoundObject, FrameSet, Gate, MissTable, PipelineError, ScoreSeparation, misses,
    separation,
};
use crate::evaluate::{
    ClassRule, Frame, Kind, NeighbourPolicy, Report, TruthFrame, evaluate, unknown_as_known,
};
use mluc_model::Model;
use mluc_refiner::Settings;

/// Everything about a model except the sweep.
#[derive(Clone, Debug)]
pub struct Judgement {
    /// How each class was judged.
    pub rules: Vec<ClassRule>,
    /// All boxes known.
    pub closed: Report,
    /// At the model's threshold.
    pub gated: Report,
    /// The model's threshold as [`Gate`] has it; 0 where none was chosen.
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
) -> Result<Judgement, PipelineError> {
    let rules = class_rules(model, unknown, neighbours)?;
    let threshold = Gate::of(model).threshold(&model.manifest.thresholds);
    let objects = objects_at(model, set, frames, settings, &[0.0, threshold], || ())?;
    let classes = class_names(model);
    let frames_at = |at: usize| -> Vec<Frame> {
        let with = |(frame, found): (&DetectedFrame, &Vec<Vec<FoundObject>>)| {
            let objects: Vec<_> = found[at].iter().map(|o| o.to_detection(&classes)).collect();
            frame.truth.with(&objects)
        };
        frames.iter().zip(&objects).map(with).collect()
    };
    let (closed, gated) = (frames_at(0), frames_at(1));
    let truths = frames.iter().map(|frame| &frame.truth);
    Ok(Judgement {
        closed: evaluate(&closed, &rules),
        gated: evaluate(&gated, &rules),
        threshold,
        separation: separation(frames, &rules),
        unknown_labels: truths.map(|truth| unknown_labels(truth, &rules)).sum(),
        unknown_as_known_closed: unknown_as_known(&closed, &rules),
        unknown_as_known: unknown_as_known(&gated, &rules),
        misses: misses(frames, &closed, &rules),
        boxes: frames.iter().map(|frame| frame.detections.len()).sum(),
        rules,
    })
}

fn unknown_labels(truth: &TruthFrame, rules: &[ClassRule]) -> usize {
    labels_that_count(truth, rules)
        .filter(|(_, rule)| rule.kind == Kind::Unknown)
        .count()
}
