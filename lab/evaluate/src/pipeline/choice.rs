//! The choice of the gate's threshold, and writing it into the model file.

use super::{ModelGate, ModelJudgement};
use crate::{ClassReport, EvaluateError, SweepPoint, best_index};
use mluc_dataset::whole_file::write_whole;
use mluc_model::{Model, model_bytes};
use std::path::Path;

/// A threshold with where it comes from.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// As [`ModelGate`] has it.
    pub threshold: f64,
    /// In words: data, refiner, rule.
    pub reason: String,
    /// By name: the figures at the threshold, the closed set's mAP, each known class' AP (40 positions) without the gate.
    pub metrics: Vec<(String, f64)>,
}

/// Chooses by the paper's rule among the points of a sweep, the closed set first. `data` and `refiner` tell where the figures come from.
pub fn choose_threshold(
    gate: ModelGate,
    sweep: &[SweepPoint],
    judgement: &ModelJudgement,
    data: &str,
    refiner: &str,
) -> Result<Choice, EvaluateError> {
    if judgement.unknown_labels() == 0 {
        let unknown = judgement.closed.unknown();
        let classes = unknown.map_or("none named".to_owned(), |c| c.rule.valid.join(", "));
        return Err(EvaluateError::Input(format!(
            "the data: expected labelled objects of the unknown classes ({classes}) that count at moderate, found none"
        )));
    }
    let (closed, point) = (sweep[0], sweep[best_index(sweep)]);
    let figures = [
        ("map_known", point.map_known),
        ("map_known_closed", closed.map_known),
        ("recall_unknown", point.recall_unknown),
        ("ap_unknown", point.ap_unknown),
        ("map_harm", point.map_harm()),
    ];
    let mut metrics = figures
        .map(|(name, value)| (name.to_owned(), value))
        .to_vec();
    let of_class = |c: &ClassReport| (format!("ap_closed_{}", c.rule.name), c.main().ap.r40);
    metrics.extend(judgement.closed.known().map(of_class));
    Ok(Choice {
        threshold: point.threshold,
        metrics,
        reason: format!(
            "best harmonic mean of mAP known and AP unknown (R40, moderate) among {} thresholds that are quantiles of the \
             kept boxes' {}, of those with mAP known at least 0.9 of the closed set's; data: {data}; refiner: {refiner}",
            sweep.len() - 1,
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
    ModelGate::of(judged).set(&mut manifest.thresholds, choice.threshold as f32);
    manifest.provenance.threshold_choice = choice.reason.clone();
    manifest.provenance.metrics.extend(choice.metrics.clone());
    let bytes = model_bytes(manifest, &model.weights)?;
    write_whole(path, &bytes)
        .map_err(|cause| EvaluateError::file(path, format!("cannot be written: {cause}")))
}
