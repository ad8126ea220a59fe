//! The choice of the gate's threshold, and writing it into the model file.

use super::{GateSweep, ModelGate, ModelJudgement};
use crate::{EvaluateError, ObjectKind, SweepPoint};
use mluc_dataset::whole_file::write_whole;
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
    gate: ModelGate,
    sweep: &GateSweep,
    judgement: &ModelJudgement,
    data: &str,
    refiner: &str,
) -> Result<Choice, EvaluateError> {
    if judgement.unknown_labels == 0 {
        let rules = judgement.rules.iter();
        let unknown = rules.filter(|rule| rule.kind == ObjectKind::Unknown);
        let classes: Vec<&str> = unknown.flat_map(|r| &r.valid).map(String::as_str).collect();
        let classes = if classes.is_empty() {
            "none named".to_owned()
        } else {
            classes.join(", ")
        };
        return Err(EvaluateError::Input(format!(
            "the data: expected labelled objects of the unknown classes ({classes}) that count at moderate, found none"
        )));
    }
    let closed_map_known = sweep.points.first().map_or(0.0, |point| point.map_known);
    let point = sweep.best.ok_or_else(|| {
        EvaluateError::Input(format!(
            "the gate: expected a threshold that keeps nine tenths of the closed set's mAP ({closed_map_known:.2}), found none"
        ))
    })?;
    let known = judgement.closed.known();
    let closed_classes = known.map(|class| (class.rule.name.clone(), class.main().ap.r40));
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
pub fn write_threshold(path: &Path, judged: &Model, choice: &Choice) -> Result<(), EvaluateError> {
    let mut model = Model::read(path)?;
    if model.fingerprint != judged.fingerprint {
        let (expected, found) = (judged.fingerprint, model.fingerprint);
        let what = format!(
            "expected the file that was judged (fingerprint {expected:016x}), found another one (fingerprint {found:016x})"
        );
        return Err(EvaluateError::file(path, what));
    }
    let manifest = &mut model.manifest;
    ModelGate::of(judged).set(&mut manifest.thresholds, choice.point.threshold as f32);
    manifest.provenance.threshold_choice = choice.reason.clone();
    let metrics = &mut manifest.provenance.metrics;
    let figures = [
        ("map_known", choice.point.map_known),
        ("map_known_closed", choice.closed_map_known),
        ("recall_unknown", choice.point.recall_unknown),
        ("ap_unknown", choice.point.ap_unknown),
        ("map_harm", choice.point.map_harm()),
    ];
    metrics.extend(figures.map(|(name, value)| (name.to_owned(), value)));
    let classes = choice.closed_classes.iter();
    metrics.extend(classes.map(|(name, ap)| (format!("ap_closed_{name}"), *ap)));
    let bytes = model_bytes(manifest, &model.weights)?;
    write_whole(path, &bytes)
        .map_err(|cause| EvaluateError::file(path, format!("cannot be written: {cause}")))
}
