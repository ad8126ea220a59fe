//! `mluc-lab evaluate method`: rows of the paper's tables on labelled scans.

use super::{Scans, report, warn_unrecognized};
use crate::commands::terminal::{counted, print_out};
use anyhow::Context;
use clap::Args;
use mluc_backbone::Precision;
use mluc_evaluate::pipeline::{
    FrameSet, GatedObjects, detect_frames, paper_rules, separation, unknown_classes,
};
use mluc_evaluate::{
    ClassRule, JudgedPoint, NeighbourPolicy, ObjectKind, OpenSetFigures, SweepPoint, best_index,
    honest,
};
use mluc_model::Model;
use mluc_reproduce::methods::{METHODS, Method, MethodInput, MethodRow, full_steps, run_method};

/// Judge methods on the boxes of one network: every threshold, the paper's choice among them, and the honest one (chosen on
/// one half of the frames, judged on the other).
///
/// `false` are unknown objects a frame beyond those that found one. All figures are of volumes (3d) at moderate, 40 recall positions, unknown objects at an overlap of 0.1.
#[derive(Args)]
pub(super) struct MethodArguments {
    /// closed-set, supervised, naive, osis, osis-geo, ml-only, uc-only, paper, paper-corrected, mluc-open, mluc-full
    /// [default: all that stand on the model's kind of head but supervised, osis and mluc-open, whose networks differ by training alone].
    /// How a network was trained is not checked.
    #[arg(long, value_delimiter = ',', value_name = "NAME,..")]
    method: Vec<String>,
    #[command(flatten)]
    scans: Scans,
    /// Of mluc-full: every step of its ablation.
    #[arg(long)]
    ablation: bool,
}

pub(super) fn run(arguments: MethodArguments) -> anyhow::Result<()> {
    let scans = &arguments.scans;
    let model = Model::read(&scans.model)?;
    let methods = methods(&arguments.method, &model)?;
    for method in &methods {
        method.check(&model)?;
    }
    let set = FrameSet::open(&scans.data, None, scans.frames)?;
    let frames = counted("network", set.names().len(), |step| {
        detect_frames(Precision::default(), &model, &set, step)
    })?;
    let rules = class_rules(&model)?;
    let labels = frames.iter().flat_map(|frame| frame.truth.labels.iter());
    warn_unrecognized(labels, &rules);
    let path = scans.model.display();
    print_out(format_args!("{path}: {}", set.describe()))?;
    print_out(report::separation(&separation(&frames, &rules)))?;
    print_out(format_args!("{:28} {}", "method", HEADER))?;
    for method in methods {
        let is_ablation = method == Method::MlucFull && arguments.ablation;
        let rows = if is_ablation {
            full_steps(&model)
        } else {
            vec![method.row().key.as_str()]
        };
        for (at, name) in rows.into_iter().enumerate() {
            let output = counted(name, set.names().len(), |step| {
                let input = MethodInput {
                    full_step: if is_ablation { at } else { usize::MAX },
                    step,
                    ..MethodInput::new(&model, &set, &frames)
                };
                run_method(method, &input)
            })?;
            let points = output.sweep(&frames, &rules);
            write_row(name, &points, &output)?;
        }
    }
    Ok(())
}

const HEADER: &str =
    "closed  known  AP.1 AP.25  AP.5  harm  recall a-ose  false  thresh | honest: known AP harm";

fn methods(names: &[String], model: &Model) -> anyhow::Result<Vec<Method>> {
    let head = model.manifest.network.head;
    if names.is_empty() {
        // A head does not tell these networks from `sigmoid`, `softmax` and `metric`.
        let by_training = [Method::Supervised, Method::Osis, Method::MlucOpen];
        let fits =
            |row: &&MethodRow| row.network.head() == head && !by_training.contains(&row.method);
        return Ok(METHODS.iter().filter(fits).map(|row| row.method).collect());
    }
    let find = |name: &String| {
        let found = MethodRow::find(name).map(|row| row.method);
        found.with_context(|| {
            let all: Vec<&str> = METHODS.iter().map(|row| row.key.as_str()).collect();
            format!("--method: expected one of {}, found {name}", all.join(", "))
        })
    };
    names.iter().map(find).collect()
}

/// The known classes at the paper's overlaps, and the unknown.
fn class_rules(model: &Model) -> anyhow::Result<Vec<ClassRule>> {
    let manifest = &model.manifest;
    let unknown = unknown_classes(&manifest.name);
    let mut known = manifest.class_names();
    known.retain(|name| !unknown.contains(name));
    let rules = paper_rules(&manifest.name, &known, &unknown, NeighbourPolicy::Official);
    Ok(rules?)
}

fn write_row(name: &str, points: &[JudgedPoint], output: &GatedObjects) -> anyhow::Result<()> {
    let closed = points.first().map_or(0.0, |p| p.all.known.r40);
    let main: Vec<SweepPoint> = points.iter().map(JudgedPoint::main).collect();
    let best = best_index(&main);
    let (point, f) = (&points[best], &points[best].all);
    let [a, b, c] = f.unknown;
    let line = format!(
        "{closed:6.2} {:6.2} {:5.2} {:5.2} {:5.2} {:5.2} {:7.2} {:5} {:6.2} {:7.4}",
        f.known.r40,
        a.r40,
        b.r40,
        c.r40,
        f.harmonic().r40,
        f.recall_unknown,
        f.unknown_as_known,
        false_unknown(output, best, f),
        point.threshold
    );
    let honest = honest(points).map_or(String::new(), |h| {
        let of = |name: &str| h.figures.get(name).copied().unwrap_or(0.0);
        let [known, unknown, harm] = ["map_known", "ap_unknown", "map_harm"].map(of);
        format!(" | {known:.2} {unknown:.2} {harm:.2}")
    });
    print_out(format_args!("{name:28} {line}{honest}"))
}

/// Unknown objects a frame at the threshold of index `at`, but for one for each label that was found.
fn false_unknown(output: &GatedObjects, at: usize, figures: &OpenSetFigures) -> f64 {
    let objects = output.objects.iter().flat_map(|frame| &frame[at]);
    let unknown = objects.filter(|o| o.kind == ObjectKind::Unknown).count() as f64;
    let found = figures.recall_unknown / 100.0 * figures.unknown_labels as f64;
    (unknown - found) / output.objects.len().max(1) as f64
}
