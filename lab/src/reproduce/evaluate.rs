//! The step that judges every row on one network.

use super::evaluated::{Evaluated, StoredObject};
use super::layout::Layout;
use super::rows::{rows_on, step_key};
use super::run::{Screen, Test};
use super::{ReproduceError, Setting};
use crate::evaluate::{
    ClassRule, JudgedFrames, JudgedPoint, Kind, NeighbourPolicy, RuleRequest, TruthFrame,
    UnknownProtocol, UnknownRequest, best_index, bootstrap, halves, honest, judged_sweep, rules,
};
use crate::methods::{ImprovedSettings, Method, MethodOutput, improved_steps, run_method_with};
use crate::pipeline::{
    DetectedFrame, FrameSet, detect_frames, known_iou_min, separation, unknown_classes,
};
use crate::report::{CurvePoint, ScoreFigures};
use mluc_model::Model;

/// Changes with the meaning of what is kept.
const FORMAT: u32 = 3;
/// The paper's overlap of an unknown.
const UNKNOWN_IOU_MIN: f64 = 0.1;
/// Seed of the bootstrap.
pub(super) const BOOTSTRAP_SEED: u64 = 1;

/// The known classes of a setting at the paper's overlaps, then the unknown.
pub(super) fn setting_rules(setting: Setting) -> Result<Vec<ClassRule>, ReproduceError> {
    rules_with(setting, NeighbourPolicy::Official)
}

fn rules_with(
    setting: Setting,
    neighbours: NeighbourPolicy,
) -> Result<Vec<ClassRule>, ReproduceError> {
    let name = setting.trainer_name();
    let known: &[&str] = match setting {
        Setting::SimUdi => &["car", "pedestrian", "cyclist", "truck"],
        Setting::SimKitti | Setting::Kitti => &["car", "pedestrian", "cyclist"],
    };
    let request = RuleRequest {
        classes: known.iter().map(|class| (*class).to_owned()).collect(),
        iou_min: known
            .iter()
            .map(|class| ((*class).to_owned(), known_iou_min(name, class)))
            .collect(),
        unknown: Some(UnknownRequest {
            classes: unknown_classes(name),
            iou_min: UNKNOWN_IOU_MIN,
            protocol: UnknownProtocol::Literal,
        }),
        neighbours,
    };
    Ok(rules(&request, &[])?)
}

/// The key of an evaluation: the network, the frames, the draws.
pub(super) fn key(model: &Model, test: &Test, resamples: usize) -> String {
    format!(
        "format {FORMAT}, model {:016x}, data {}, {} frames, {resamples} draws",
        model.fingerprint,
        test.hash,
        test.set.len()
    )
}

/// Reads the model of a run and checks that it is of the setting.
pub(super) fn read_model(
    layout: &Layout,
    setting: Setting,
    network: &str,
    seed: u64,
) -> Result<Model, ReproduceError> {
    let path = layout.model_of(setting, network, seed);
    let model = Model::read(&path)?;
    if model.manifest.name != setting.trainer_name() {
        return Err(ReproduceError::OtherSetting {
            path,
            expected: setting.trainer_name(),
            found: model.manifest.name,
        });
    }
    Ok(model)
}

/// Judges every row on a network that is not judged yet, and the improved method's steps. Frames go through the network once.
pub(super) fn evaluate_network(
    layout: &Layout,
    test: &Test,
    (network, seed): (&'static str, u64),
    resamples: usize,
    screen: &dyn Screen,
) -> Result<(), ReproduceError> {
    let setting = test.setting;
    let model = read_model(layout, setting, network, seed)?;
    let key = key(&model, test, resamples);
    let missing: Vec<Job> = jobs(&model, network, seed)
        .into_iter()
        .filter(|job| {
            Evaluated::read(&layout.evaluation_of(setting, &job.key, seed), &key).is_none()
        })
        .collect();
    if missing.is_empty() {
        return Ok(());
    }
    for method in missing.iter().filter_map(|job| method_of(job.method)) {
        method
            .check(&model)
            .map_err(|cause| ReproduceError::OtherNetwork {
                path: layout.model_of(setting, network, seed),
                cause,
            })?;
    }
    screen.count("network", test.set.len() as u64);
    let frames = detect_frames(&model, &test.set, || screen.tick())?;
    let rules = setting_rules(setting)?;
    let strict = rules_with(setting, NeighbourPolicy::Strict)?;
    let truths: Vec<TruthFrame> = frames.iter().map(|frame| frame.truth.clone()).collect();
    let separation = score_figures(&frames, &rules);
    for job in missing {
        screen.count(&job.key, test.set.len() as u64);
        let step = || screen.tick();
        let output = method_output(
            job.method,
            &job.settings,
            &model,
            &test.set,
            &frames,
            None,
            &step,
        )?;
        let mut evaluated = judge(&truths, [&rules, &strict], &output, resamples);
        (evaluated.method, evaluated.network) = (job.method.to_owned(), network.to_owned());
        (evaluated.seed, evaluated.key) = (seed, key.clone());
        evaluated.separation.clone_from(&separation);
        evaluated.write(&layout.evaluation_of(setting, &job.key, seed))?;
    }
    Ok(())
}

/// Something to be judged: a row, or the improved method as it was after one of its steps.
struct Job {
    key: String,
    method: &'static str,
    settings: ImprovedSettings,
}

fn jobs(model: &Model, network: &str, seed: u64) -> Vec<Job> {
    let row = |method: &'static str| Job {
        key: method.to_owned(),
        method,
        settings: ImprovedSettings::default(),
    };
    let mut jobs: Vec<Job> = rows_on(network, seed).map(row).collect();
    if network == "improved" && seed == 1 {
        let mut steps = improved_steps(model);
        // The last one is the row itself.
        steps.pop();
        jobs.extend(
            steps
                .into_iter()
                .enumerate()
                .map(|(at, (_, settings))| Job {
                    key: step_key(at),
                    method: "improved",
                    settings,
                }),
        );
    }
    jobs
}

fn method_of(key: &str) -> Option<Method> {
    Method::ALL.into_iter().find(|method| method.name() == key)
}

/// A row by its key.
pub(super) fn method_output(
    key: &'static str,
    improved: &ImprovedSettings,
    model: &Model,
    set: &FrameSet,
    frames: &[DetectedFrame],
    thresholds: Option<&[f64]>,
    step: &(dyn Fn() + Sync),
) -> Result<MethodOutput, ReproduceError> {
    let method = method_of(key).ok_or_else(|| ReproduceError::Method {
        method: key,
        reason: "expected a method of this name, found none".into(),
    })?;
    Ok(run_method_with(
        method, improved, model, set, frames, thresholds, step,
    )?)
}

/// Sweep, choice, honest protocol, bootstrap; at the chosen threshold also by the strict rules.
pub(super) fn judge(
    truths: &[TruthFrame],
    [rules, strict]: [&[ClassRule]; 2],
    output: &MethodOutput,
    resamples: usize,
) -> Evaluated {
    let [even, odd] = halves(truths.len());
    let parts = vec![(0..truths.len()).collect(), even, odd];
    let found = |frame: usize, at: usize| {
        let objects = output.objects[frame][at].iter();
        objects
            .map(|o| o.to_detection(&output.classes))
            .collect::<Vec<_>>()
    };
    let points = judged_sweep(truths, rules, &output.thresholds, &parts, found);
    let best = best_index(&points, 0).unwrap_or(0);
    let frames: Vec<_> = truths
        .iter()
        .enumerate()
        .map(|(i, truth)| truth.with(&found(i, best)))
        .collect();
    let judged = JudgedFrames::of(&frames, rules);
    Evaluated {
        key: String::new(),
        method: String::new(),
        network: String::new(),
        seed: 0,
        threshold: points.get(best).map_or(0.0, |point| point.threshold),
        figures: judged.all(),
        strict: JudgedFrames::of(&frames, strict).all(),
        bootstrap: bootstrap(&judged, resamples, BOOTSTRAP_SEED),
        honest: honest(&points, [1, 2]),
        curve: points.iter().map(curve_point).collect(),
        separation: Vec::new(),
        unknown_score_min: judged.unknown_score_min(),
        objects: (0..truths.len())
            .map(|frame| found(frame, best).iter().map(StoredObject::of).collect())
            .collect(),
    }
}

fn curve_point(point: &JudgedPoint) -> CurvePoint {
    let figures = &point.parts[0];
    CurvePoint {
        threshold: point.threshold,
        recall_unknown: figures.recall_unknown,
        ap_unknown: figures.unknown[0].r40,
        map_known: figures.known.r40,
    }
}

fn score_figures(frames: &[DetectedFrame], rules: &[ClassRule]) -> Vec<ScoreFigures> {
    separation(frames, rules)
        .into_iter()
        .map(|s| ScoreFigures {
            score: s.score.to_owned(),
            auroc: s.auroc,
            fpr95: s.fpr95,
            auroc_background: s.auroc_background,
            known: s.known,
            unknown: s.unknown,
            background: s.background,
        })
        .collect()
}

/// Labels that count at moderate by name of the rule.
pub(super) fn label_counts(
    set: &FrameSet,
    rules: &[ClassRule],
) -> Result<Vec<(String, Kind, usize)>, ReproduceError> {
    let frames = (0..set.len()).map(|i| Ok(set.truth(i)?.with(&[])));
    let frames: Vec<_> = frames.collect::<Result<_, ReproduceError>>()?;
    let judged = JudgedFrames::of(&frames, rules).all();
    let known = judged
        .classes
        .into_iter()
        .map(|c| (c.class, Kind::Known, c.labels));
    let unknown = [("unknown".to_owned(), Kind::Unknown, judged.unknown_labels)];
    Ok(known.chain(unknown).collect())
}
