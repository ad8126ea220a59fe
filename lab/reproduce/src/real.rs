//! Rows on recorded scans, with networks and thresholds from simulated scans alone: nothing is chosen on them.

use crate::Evaluated;
use crate::Setting;
use crate::error::ReproduceError;
use crate::evaluate::read_model;
use crate::layout::Layout;
use crate::methods::{MethodInput, MethodRow, run_method};
use crate::options::{Screen, TestFrames};
use crate::report::RealRow;
use mluc_evaluate::pipeline::{FrameSet, detect_frames, unknown_classes};
use mluc_evaluate::{
    ClassReport, ClassRule, Difficulty, LabelledFrame, Metric, NeighbourPolicy, UNKNOWN_IOUS,
    UnknownProtocol, evaluate,
};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Overlaps on recorded scans: smaller than KITTI's, since simulated boxes differ from drawn ones.
const IOU_MIN: [(&str, f64); 3] = [("car", 0.5), ("pedestrian", 0.25), ("cyclist", 0.25)];

/// Every evaluated row of the simulated setting on each folder by itself, and on all of them pooled.
pub(crate) fn real_rows(
    layout: &Layout,
    test: &TestFrames,
    evaluated: &BTreeMap<&'static str, Vec<Evaluated>>,
    folders: &[PathBuf],
    screen: &dyn Screen,
) -> Result<Vec<RealRow>, ReproduceError> {
    if test.setting != Setting::SimKitti {
        return Ok(Vec::new());
    }
    let first = evaluated.iter().filter_map(|(key, seeds)| {
        let row = MethodRow::find(key)?;
        Some((row, seeds.first()?))
    });
    let first: Vec<(&'static MethodRow, &Evaluated)> = first.collect();
    let mut found: BTreeMap<&str, Vec<Vec<LabelledFrame>>> = BTreeMap::new();
    for folder in folders {
        let set = FrameSet::open(folder, None, usize::MAX)?;
        let mut by_network = BTreeMap::new();
        for (row, chosen) in &first {
            let name = row.network().name();
            if !by_network.contains_key(name) {
                let model = read_model(layout, test.setting, row.network(), chosen.seed)?;
                screen.count("recorded scans", set.len() as u64);
                let frames = detect_frames(&model, &set, || screen.tick())?;
                by_network.insert(name, (model, frames));
            }
            let (model, frames) = &by_network[name];
            // The closed set first, as every method has it.
            let closed = chosen.curve.first().map_or(0.0, |point| point.threshold);
            let mut asked = vec![closed, chosen.threshold];
            asked.dedup();
            let input = MethodInput {
                thresholds: Some(&asked),
                ..MethodInput::new(model, &set, frames)
            };
            let output = run_method(row.method, &input)?;
            let last = output.thresholds.len().saturating_sub(1);
            let frames = frames.iter().enumerate();
            let judged = frames.map(|(i, frame)| frame.truth.with(&output.detections(i, last)));
            found.entry(&row.key).or_default().push(judged.collect());
        }
    }
    let mut rows = Vec::new();
    for (row, chosen) in &first {
        let sets = found.get(row.key.as_str()).map_or(&[][..], Vec::as_slice);
        for (folder, frames) in folders.iter().zip(sets) {
            rows.push(real_row(&row.key, &tail(folder), chosen.threshold, frames));
        }
        if sets.len() > 1 {
            rows.push(real_row(
                &row.key,
                "pooled",
                chosen.threshold,
                &sets.concat(),
            ));
        }
    }
    Ok(rows)
}

/// The last two parts of a path: they tell folders apart without telling where they lie.
fn tail(folder: &Path) -> String {
    let parts: Vec<_> = folder.iter().map(|part| part.to_string_lossy()).collect();
    parts[parts.len().saturating_sub(2)..].join("/")
}

fn real_row(method: &str, data: &str, threshold: f64, frames: &[LabelledFrame]) -> RealRow {
    let [literal, fair] =
        [UnknownProtocol::Literal, UnknownProtocol::Fair].map(|protocol| reports(frames, protocol));
    let entry = |class: &ClassReport| *class.entry(Metric::Space, Difficulty::Moderate);
    let by_class = literal.iter().map(|c| (c.rule.name.clone(), entry(c)));
    let by_class: BTreeMap<_, _> = by_class.collect();
    RealRow {
        method: method.to_owned(),
        data: data.to_owned(),
        frames: frames.len(),
        threshold,
        ap_all: by_class
            .iter()
            .map(|(n, e)| (n.clone(), e.ap.all))
            .collect(),
        ap_unknown_fair: fair.last().map(|class| entry(class).ap.all),
        labels: by_class
            .iter()
            .map(|(n, e)| (n.clone(), e.truth_count))
            .collect(),
        recall_unknown: literal.last().map_or(0.0, |c| entry(c).recall_percent),
    }
}

/// The known classes, then the unknown one.
fn reports(frames: &[LabelledFrame], protocol: UnknownProtocol) -> Vec<ClassReport> {
    let known = |(class, iou): (&str, f64)| ClassRule::known(class, iou, NeighbourPolicy::Official);
    let mut rules: Vec<ClassRule> = IOU_MIN.into_iter().map(known).collect();
    let unknown = unknown_classes("kitti");
    rules.push(ClassRule::unknown(&unknown, UNKNOWN_IOUS[0], protocol));
    evaluate(frames, &rules).classes
}
