//! The choice of the gate's threshold, and writing it into the model file.

use super::{Gate, GateSweep, Judgement, PipelineError};
use crate::evaluate::{Difficulty, Kind, Metric, SweepPoint};
use crate::whole_file::write_whole;
use mluc_model::{Model, model_bytes};
use std::path::Path;

/// A threshold with where it comes from.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// The threshold and its figures.
    pub point: SweepPoint,
    /// Mean AP of the known without the gate.
    pub closed_map_known: f64,
    /// Average precision (40 positions) of each known class without the gate.
    pub closed_classes: Vec<(String, f64)>,
    /// In words: data, refiner, rule.
    pub reason: String,
}

/// Chooses by the paper's rule. `data` and `refiner` tell where the figures come from.
pub fn choose_threshold(
    gate: Gate,
    sweep: &GateSweep,
    judgement: &Judgement,
    data: &str,
    refiner: &str,
) -> Result<Choice, PipelineError> {
    if judgement.unknown_labels == 0 {
        let unknown = judgement
            .rules
            .iter()
            .filter(|rule| rule.kind == Kind::Unknown);
        let classes: Vec<&String> = unknown.flat_map(|rule| &rule.valid).collect();
        let classes = classes.iter().map(|c| c.as_str()).collect::<Vec<_>>();
        return Err(PipelineError::NoUnknown {
            classes: classes.join(", "),
        });
    }
    let closed_map_known = sweep.points.first().map_or(0.0, |point| point.map_known);
    let point = sweep.best.ok_or(PipelineError::NoThreshold {
        closed: closed_map_known,
    })?;
    let known = judgement.closed.classes.iter();
    let closed_classes = known
        .filter(|class| class.rule.kind == Kind::Known)
        .map(|class| {
            let ap = class.entry(Metric::Space, Difficulty::Moderate).ap;
            (class.rule.name.clone(), ap.r40)
        });
    Ok(Choice {
        point,
        closed_map_known,
        closed_classes: closed_classes.collect(),
        reason: format!(
            "best harmonic mean of mAP known and AP unknown (R40, moderate) among {} thresholds that are quantiles of the \
             kept boxes' {}, of those with mAP known at least 0.9 of the closed set's; data: {data}; refiner: {refiner}",
            sweep.points.len() - 1,
            gate.describe()
        ),
    })
}

/// Puts a choice into the model file that was judged: the threshold, how it was chosen, and the figures. The file is
/// replaced as a whole or not at all; a file that changed since it was judged is left alone.
pub fn write_threshold(path: &Path, judged: &Model, choice: &Choice) -> Result<(), PipelineError> {
    let mut model = Model::read(path)?;
    if model.fingerprint != judged.fingerprint {
        return Err(PipelineError::ModelChanged {
            path: path.to_owned(),
            expected: judged.fingerprint,
            found: model.fingerprint,
        });
    }
    let manifest = &mut model.manifest;
    Gate::of(judged).set(&mut manifest.thresholds, choice.point.threshold as f32);
    manifest.provenance.threshold_choice = choice.reason.clone();
    let metrics = &mut manifest.provenance.metrics;
    let figures = [
        ("map_known", choice.point.map_known),
        ("map_known_closed", choice.closed_map_known),
        ("recall_unknown", choice.point.recall_unknown),
        ("ap_unknown", choice.point.ap_unknown),
        ("map_harm", choice.point.map_harm),
    ];
    metrics.extend(figures.map(|(name, value)| (name.to_owned(), value)));
    let classes = choice.closed_classes.iter();
    metrics.extend(classes.map(|(name, ap)| (format!("ap_closed_{name}"), *ap)));
    let bytes = model_bytes(manifest, &model.weights)?;
    write_whole(path, &bytes).map_err(|cause| PipelineError::Write {
        path: path.to_owned(),
        cause,
    })
}
