//! A model's figures at its own threshold, without the gate, and at many thresholds; the choice of a threshold for the model file.

use super::separation::{ScoreSeparation, separation};
use super::{
    DetectedFrame, FrameSet, ModelGate, THRESHOLDS, detect_frames, objects_at, paper_rules,
};
use crate::open_set::unknown_as_known;
use crate::{
    ApReport, Breakdown, ClassReport, ClassRule, EvaluateError, FrameRings, JudgedPoint,
    LabelledFrame, ObjectKind, Operating, Result, SweepPoint, evaluate,
};
use mluc_backbone::Precision;
use mluc_dataset::whole_file::write_whole;
use mluc_model::{HeadKind, Manifest, Model, Probabilities, Profiles, ScoreMin, model_bytes};
use mluc_refiner::Settings;
use rayon::prelude::*;
use std::path::Path;

/// All figures of a model except the sweep.
#[derive(Clone, Debug)]
pub struct ModelJudgement {
    /// The rule of each class.
    pub rules: Vec<ClassRule>,
    /// AP with all boxes known.
    pub closed: ApReport,
    /// AP at the model's threshold.
    pub gated: ApReport,
    /// The model's threshold in the scale of [`ModelGate`]; 0 where none was chosen.
    pub threshold: f32,
    /// Separation of unknown from known boxes, by score.
    pub separation: Vec<ScoreSeparation>,
    /// Number of unknown labels that a known object overlaps (absolute open-set error), without the gate.
    pub unknown_as_known_closed: usize,
    /// The same at the model's threshold.
    pub unknown_as_known: usize,
    /// AP at the model's threshold by range, and by rings on the object.
    pub breakdowns: [Breakdown; 2],
    /// Boxes that the network kept.
    pub boxes: usize,
}

impl ModelJudgement {
    /// Number of unknown labels that count.
    pub fn unknown_labels(&self) -> usize {
        self.gated.unknown().map_or(0, |class| class.main().truth_count)
    }
}

/// Evaluates the detections of a set; `unknown` are the label classes that count as unknown.
pub fn judge(
    model: &Model,
    set: &FrameSet,
    frames: &[DetectedFrame],
    unknown: &[String],
    settings: &Settings,
) -> Result<ModelJudgement> {
    let classes = model.manifest.class_names();
    let rules = paper_rules(&model.manifest.name, &classes, unknown)?;
    let gate = ModelGate::of(model);
    let threshold = gate.threshold(&model.manifest.thresholds);
    let asked = vec![0.0, f64::from(threshold)];
    let objects = objects_at(model, gate, set, frames, settings, asked, &|| ())?;
    let [closed, gated] = [0, 1].map(|at| objects.labelled(frames, at));
    let rings_of = |index: usize| {
        let (calibration, points) = (&frames[index].truth.calibration, set.points(index)?);
        Ok(FrameRings::of(&gated[index], calibration, &points))
    };
    let rings: Result<Vec<_>> = (0..frames.len()).into_par_iter().map(rings_of).collect();
    Ok(ModelJudgement {
        closed: evaluate(&closed, &rules),
        gated: evaluate(&gated, &rules),
        breakdowns: [
            Breakdown::by_range(&gated, &rules),
            Breakdown::by_rings(&gated, &rings?, &rules),
        ],
        threshold,
        separation: separation(frames, &rules),
        unknown_as_known_closed: unknown_as_known(&closed, &rules),
        unknown_as_known: unknown_as_known(&gated, &rules),
        boxes: frames.iter().map(|frame| frame.detections.len()).sum(),
        rules,
    })
}

/// The figures of the closed set, then the figures at [`THRESHOLDS`] thresholds of the model's gate, ascending. The refiner runs on every frame
/// at every threshold (`step` is called after each frame).
pub fn sweep_gate(
    model: &Model,
    set: &FrameSet,
    frames: &[DetectedFrame],
    rules: &[ClassRule],
    settings: &Settings,
    step: &(dyn Fn() + Sync),
) -> Result<Vec<SweepPoint>> {
    let gate = ModelGate::of(model);
    // A closed-set detector has only the closed set.
    let has_gate = model.manifest.network.head != HeadKind::Sigmoid;
    let thresholds = gate.thresholds(frames, THRESHOLDS * usize::from(has_gate));
    let objects = objects_at(model, gate, set, frames, settings, thresholds, step)?;
    let points = objects.sweep(frames, rules);
    Ok(points.iter().map(JudgedPoint::main).collect())
}

/// A threshold and its origin.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// In the scale of [`ModelGate`].
    pub threshold: f64,
    /// In words: data, refiner, rule.
    pub reason: String,
    /// By name: the figures at the threshold, the mAP of the closed set, the AP of each known class (40 positions) without the gate.
    pub metrics: Vec<(String, f64)>,
}

/// Chooses among the points of a sweep, closed set first. `data` and `refiner` say how the figures were obtained.
pub fn choose_threshold(
    gate: ModelGate,
    sweep: &[SweepPoint],
    judgement: &ModelJudgement,
    data: &str,
    refiner: &str,
) -> Choice {
    let (closed, point) = (sweep[0], sweep[gate.best_index(sweep)]);
    let figures = [
        ("map_known", point.map_known),
        ("map_known_closed", closed.map_known),
        ("recall_unknown", point.recall_unknown),
        ("ap_unknown", point.ap_unknown),
        ("map_harm", point.map_harm()),
    ];
    let named = figures.map(|(name, value)| (name.to_owned(), value));
    let of_class = |c: &ClassReport| (format!("ap_closed_{}", c.rule.name), c.main().ap.r40);
    let of_classes = judgement.closed.known().map(of_class);
    Choice {
        threshold: point.threshold,
        metrics: named.into_iter().chain(of_classes).collect(),
        reason: format!(
            "{}, among {} thresholds; data: {data}; refiner: {refiner}",
            gate.rule(),
            sweep.len() - 1,
        ),
    }
}

/// The values chosen for published scores.
#[derive(Clone, Debug, PartialEq)]
pub struct ScoreChoice {
    /// Scores of the operating profiles.
    pub profiles: Profiles,
    /// Table from scores to probabilities, from all scans.
    pub probabilities: Probabilities,
    /// By name of the kind, for the objects that `balanced` publishes: the calibration errors of the scores and of the probabilities. The table is
    /// fitted on every other scan and checked on the rest, then the other way round. `None` where a half has no objects.
    pub errors: Vec<(&'static str, [[Option<f64>; 2]; 2])>,
}

/// The scores of the operating profiles at the model's own threshold: the lowest score at which the upper 95 % bound of the objects per scan
/// on no label is at most 0.1 (unknown, in each third of the scans by point count) and 0.2 (known, in all) for `quiet`, 0.3 and 0.5 for
/// `balanced`. Also the table from scores to probabilities, with the unknown objects that `balanced` publishes.
pub fn choose_profiles(
    model: &Model,
    set: &FrameSet,
    frames: &[DetectedFrame],
    rules: &[ClassRule],
    settings: &Settings,
) -> Result<ScoreChoice> {
    let gate = ModelGate::of(model);
    let threshold = f64::from(gate.threshold(&model.manifest.thresholds));
    let published = |unknown: f32, known: f32| {
        let mut settings = settings.clone();
        (settings.score_min.unknown, settings.score_min.known) = (unknown, known);
        let objects = objects_at(model, gate, set, frames, &settings, vec![threshold], &|| ())?;
        Ok::<_, EvaluateError>(objects.labelled(frames, 0))
    };
    let operating = |scans: &[LabelledFrame]| operating_of(scans, rules);
    let of_unknown = published(0.0, 0.0)?;
    let judged = operating(&of_unknown);
    // Scans with more points give more false objects: the limit applies to each third of the scans by point count.
    let points = |index| Ok((set.points(index)?.len(), index));
    let points: Result<Vec<_>> = (0..frames.len()).into_par_iter().map(points).collect();
    let mut by_points = points?;
    by_points.sort_unstable();
    let unknown_min = |scans: &[LabelledFrame], most: f64| {
        let third = |third: &[(usize, usize)]| {
            let scans = third.iter().map(|&(_, at)| scans[at].clone());
            operating(&scans.collect::<Vec<_>>()).safe_score_min(ObjectKind::Unknown, most)
        };
        by_points.chunks(frames.len().div_ceil(3).max(1)).map(third).fold(0.0, f32::max)
    };
    // An object that is not published as unknown may be published as known, and the points of a known object that is not published may be unknown.
    let least = |most_unknown: f64, most_known: f64| {
        let (mut unknown, mut known) = (unknown_min(&of_unknown, most_unknown), 0.0_f32);
        let mut left = published(unknown, 0.0)?;
        // Each score raises the other, if at all, by less and less.
        for _ in 0..4 {
            known = operating(&left).safe_score_min(ObjectKind::Known, most_known).max(known);
            let more = unknown_min(&published(0.0, known)?, most_unknown);
            if more <= unknown {
                break;
            }
            unknown = more;
            left = published(unknown, 0.0)?;
        }
        let score_min = ScoreMin { known, unknown, both_readings: false };
        Ok::<_, EvaluateError>((score_min, left))
    };
    let (quiet, _) = least(0.1, 0.2)?;
    let (balanced, of_known) = least(0.3, 0.5)?;
    let errors = |kind: ObjectKind, scans: &[LabelledFrame], score_min| {
        errors_of_halves(kind, scans, rules, score_min)
    };
    Ok(ScoreChoice {
        profiles: Profiles { quiet, balanced },
        probabilities: Probabilities {
            unknown: judged.probabilities().unknown,
            known: operating(&of_known).probabilities().known,
        },
        errors: vec![
            ("unknown", errors(ObjectKind::Unknown, &of_unknown, balanced.unknown)),
            ("known", errors(ObjectKind::Known, &of_known, balanced.known)),
        ],
    })
}

/// Every scan is a drive of its own: scans of validation show different scenes. Scans of one drive give scores that are too low.
fn operating_of(scans: &[LabelledFrame], rules: &[ClassRule]) -> Operating {
    Operating::of(scans, &vec![1; scans.len()], rules)
}

/// The calibration errors of each half of the scans (even, odd) by the table of the other half: of the scores, and of the probabilities.
fn errors_of_halves(
    kind: ObjectKind,
    scans: &[LabelledFrame],
    rules: &[ClassRule],
    score_min: f32,
) -> [[Option<f64>; 2]; 2] {
    let halves = [0, 1].map(|half| {
        let every_other = scans.iter().skip(half).step_by(2);
        operating_of(&every_other.cloned().collect::<Vec<_>>(), rules)
    });
    [0, 1].map(|half: usize| {
        let table = halves[1 - half].probabilities();
        halves[half].calibration_errors(kind, score_min, &table)
    })
}

/// Writes the scores of the profiles and the table of probabilities into the evaluated model file, with the data that they were chosen on.
pub fn write_profiles(path: &Path, judged: &Model, chosen: &ScoreChoice, data: &str) -> Result<()> {
    rewrite(path, judged, |manifest| {
        manifest.thresholds.profiles = Some(chosen.profiles);
        manifest.thresholds.probabilities = Some(chosen.probabilities.clone());
        manifest.provenance.profile_choice = format!(
            "lowest scores at which the upper 95 % bound (bootstrap) of the objects a scan on no label is at most 0.1 unknown (in each \
             third of the scans by their points) and 0.2 known (quiet), 0.3 and 0.5 (balanced); probabilities: share of objects on a label \
             of their kind, by range, made to rise \
             with the score; data: {data}"
        );
    })
}

/// Measures a model file at its threshold in every precision that it can run in and writes the figures into it: a run with `auto` chooses by
/// these figures. `step` is called after each frame.
pub fn write_precisions(
    path: &Path,
    set: &FrameSet,
    unknown: &[String],
    settings: &Settings,
    step: &(dyn Fn() + Sync),
) -> Result<()> {
    let model = Model::read(path)?;
    let mut metrics = vec![];
    for precision in Precision::ALL {
        if precision == Precision::Int8 && !model.weights.is_calibrated() {
            continue;
        }
        let frames = detect_frames(precision, &model, set, step)?;
        let judged = judge(&model, set, &frames, unknown, settings)?.gated;
        let unknown_ap = judged.unknown().map_or(0.0, |class| class.main().ap.r40);
        let figures = [judged.map_known().r40, unknown_ap];
        metrics.extend(precision.metrics().into_iter().zip(figures));
    }
    rewrite(path, &model, |manifest| {
        manifest.provenance.metrics.extend(metrics);
    })
}

/// Writes a choice into the evaluated model file: the threshold, how it was chosen, and the figures. Scores of profiles and probabilities
/// that were chosen at another threshold are removed.
pub fn write_threshold(path: &Path, judged: &Model, choice: &Choice) -> Result<()> {
    rewrite(path, judged, |manifest| {
        let before = manifest.thresholds.clone();
        ModelGate::of(judged).set(&mut manifest.thresholds, choice.threshold as f32);
        if manifest.thresholds != before {
            manifest.thresholds.profiles = None;
            manifest.thresholds.probabilities = None;
            manifest.provenance.profile_choice.clear();
        }
        manifest.provenance.threshold_choice = choice.reason.clone();
        let metrics = &mut manifest.provenance.metrics;
        // Those of another threshold, refiner or data: `--precision auto` must not compare with them.
        metrics.retain(|name, _| !name.ends_with("_bf16") && !name.ends_with("_int8"));
        metrics.extend(choice.metrics.clone());
    })
}

/// The file is replaced completely or not at all; a file that changed since its evaluation is left unchanged.
fn rewrite(path: &Path, judged: &Model, change: impl FnOnce(&mut Manifest)) -> Result<()> {
    let mut model = Model::read(path)?;
    if model.fingerprint != judged.fingerprint {
        let (expected, found) = (judged.fingerprint, model.fingerprint);
        let what = format!(
            "expected the file that was judged (fingerprint {expected:016x}), found another one (fingerprint {found:016x})"
        );
        return Err(EvaluateError::file(path, what));
    }
    change(&mut model.manifest);
    let bytes = model_bytes(&model.manifest, &model.weights)?;
    write_whole(path, &bytes)
        .map_err(|cause| EvaluateError::file(path, format!("cannot be written: {cause}")))
}
