//! The step that evaluates every row on one network.

use crate::methods::{Method, MethodInput, MethodRow, full_steps, run_method};
use crate::{Result, Setting, evaluated::Evaluated};
use crate::{layout::Layout, layout::Run, options::Screen, options::TestFrames};
use mluc_backbone::Precision;
use mluc_evaluate::pipeline::{DetectedFrame, GatedObjects, detect_frames};
use mluc_evaluate::pipeline::{paper_rules, separation, unknown_classes};
use mluc_evaluate::{ClassRule, EvaluateError, JudgedFrames};
use mluc_evaluate::{JudgedPoint, SweepPoint, best_index, honest};
use mluc_model::Model;
use mluc_train::NetworkKind;

/// Version of the stored evaluations; changes with their meaning.
const FORMAT: u32 = 8;
pub(crate) const BOOTSTRAP_SEED: u64 = 1;

/// The known classes of a setting at the paper's overlaps, then the unknown.
pub(crate) fn setting_rules(setting: Setting) -> Result<Vec<ClassRule>> {
    let name = setting.trainer_name();
    let known = ["car", "pedestrian", "cyclist", "truck"].map(str::to_owned);
    let count = if setting == Setting::SimUdi { 4 } else { 3 };
    paper_rules(name, &known[..count], &unknown_classes(name))
}

/// The key of an evaluation: the network, the frames, the number of resamples.
pub(crate) fn key(model: &Model, test: &TestFrames) -> String {
    format!(
        "format {FORMAT}, model {:016x}, data {}, {} frames, {} draws",
        model.fingerprint,
        test.hash,
        test.set.names().len(),
        test.resamples
    )
}

/// Reads the model of a run and checks its setting.
pub(crate) fn read_model(layout: &Layout, run: Run) -> Result<Model> {
    let path = layout.model_of(run);
    let model = Model::read(&path)?;
    let (expected, found) = (run.0.trainer_name(), &model.manifest.name);
    if found != expected {
        let what = format!("expected a model of setting {expected}, found {found}");
        return Err(EvaluateError::file(&path, what));
    }
    Ok(model)
}

/// Evaluates every row on a network without a current evaluation, and the steps of our method. The network runs once per frame.
pub(crate) fn evaluate_network(
    layout: &Layout,
    test: &TestFrames,
    run: Run,
    screen: &dyn Screen,
) -> Result<()> {
    let (setting, network, seed) = run;
    let model = read_model(layout, run)?;
    let key = key(&model, test);
    let mut missing = jobs(&model, network, seed);
    let path = |name: &str| layout.evaluation_of(setting, name, seed);
    missing.retain(|(name, ..)| Evaluated::read(&path(name), &key).is_none());
    if missing.is_empty() {
        return Ok(());
    }
    let file = layout.model_of(run);
    for (_, method, _) in &missing {
        method.check(&model).map_err(|cause| EvaluateError::file(&file, cause))?;
    }
    screen.count("network", test.set.names().len() as u64);
    let frames = detect_frames(Precision::default(), &model, &test.set, || screen.tick())?;
    let rules = setting_rules(setting)?;
    // Here a van found as a car is wrong.
    let mut strict = rules.clone();
    strict.iter_mut().for_each(|rule| rule.ignored.clear());
    let separation = separation(&frames, &rules);
    for (name, method, full_step) in missing {
        screen.count(&name, test.set.names().len() as u64);
        let input = MethodInput {
            full_step,
            step: &|| screen.tick(),
            ..MethodInput::new(&model, &test.set, &frames)
        };
        let output = run_method(method, &input)?;
        let evaluated = Evaluated {
            key: key.clone(),
            network: network.name(),
            seed,
            separation: separation.clone(),
            ..judge(&frames, [&rules, &strict], &output, test.resamples)
        };
        evaluated.write(&path(&name))?;
    }
    Ok(())
}

/// An evaluation to make, of a row or of our method after one of its steps: its key, method and last step.
type Job = (String, Method, usize);

fn jobs(model: &Model, network: NetworkKind, seed: u64) -> Vec<Job> {
    let row = |row: &MethodRow| (row.key.clone(), row.method, usize::MAX);
    let mut jobs: Vec<Job> = MethodRow::on(network, seed).map(row).collect();
    if network == Method::MlucFull.row().network && seed == 1 {
        // The last step is the row itself.
        let steps = 0..full_steps(model).len() - 1;
        jobs.extend(steps.map(|step| (step_key(step), Method::MlucFull, step)));
    }
    jobs
}

/// Key of an evaluation of one step of our method.
pub(crate) fn step_key(step: usize) -> String {
    format!("{}-step{step}", Method::MlucFull.row().key)
}

/// Sweep, choice, honest protocol, bootstrap; at the chosen threshold also figures by the strict rules.
fn judge(
    frames: &[DetectedFrame],
    [rules, strict]: [&[ClassRule]; 2],
    output: &GatedObjects,
    resamples: usize,
) -> Evaluated {
    let points = output.sweep(frames, rules);
    let curve: Vec<SweepPoint> = points.iter().map(JudgedPoint::main).collect();
    let best = best_index(&curve);
    let labelled = output.labelled(frames, best);
    let judged = JudgedFrames::of(&labelled, rules);
    Evaluated {
        threshold: curve.get(best).map_or(0.0, |point| point.threshold),
        figures: judged.all(),
        strict: JudgedFrames::of(&labelled, strict).all(),
        bootstrap: judged.bootstrap(resamples, BOOTSTRAP_SEED),
        honest: honest(&points),
        curve,
        unknown_score_min: judged.unknown_score_min(),
        objects: output.objects.iter().map(|at| at[best].clone()).collect(),
        ..Evaluated::default()
    }
}
