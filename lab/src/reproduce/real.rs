//! Rows on recorded scans, with networks and thresholds from simulated scans alone: nothing is chosen on them.

use super::evaluate::{method_output, read_model};
use super::evaluated::Evaluated;
use super::layout::Layout;
use super::run::{Screen, Test};
use super::{ReproduceError, Setting};
use crate::evaluate::{
    ClassReport, Difficulty, Frame, Metric, NeighbourPolicy, RuleRequest, UnknownProtocol,
    UnknownRequest, evaluate, rules,
};
use crate::methods::ImprovedSettings;
use crate::pipeline::{FrameSet, detect_frames, unknown_classes};
use crate::report::RealRow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Overlaps on recorded scans: smaller than KITTI's, since simulated boxes differ from drawn ones.
const IOU_MIN: [(&str, f64); 3] = [("car", 0.5), ("pedestrian", 0.25), ("cyclist", 0.25)];
const UNKNOWN_IOU_MIN: f64 = 0.1;

/// Every evaluated row of the simulated setting on each folder by itself, and on all of them pooled.
pub(super) fn real_rows(
    layout: &Layout,
    test: &Test,
    evaluated: &BTreeMap<&'static str, Vec<Evaluated>>,
    folders: &[PathBuf],
    screen: &dyn Screen,
) -> Result<Vec<RealRow>, ReproduceError> {
    if test.setting != Setting::SimKitti || folders.is_empty() {
        return Ok(Vec::new());
    }
    let sets: Vec<FrameSet> = folders
        .iter()
        .map(|folder| FrameSet::open(folder, None, usize::MAX))
        .collect::<Result<_, _>>()?;
    let mut found: BTreeMap<&'static str, Vec<Vec<Frame>>> = BTreeMap::new();
    for set in &sets {
        let mut by_network = BTreeMap::new();
        for (method, seeds) in evaluated {
            let Some(chosen) = seeds.first() else {
                continue;
            };
            let network = chosen.network.as_str();
            if !by_network.contains_key(network) {
                let model = read_model(layout, test.setting, network, chosen.seed)?;
                screen.count("recorded scans", set.len() as u64);
                let frames = detect_frames(&model, set, || screen.tick())?;
                by_network.insert(network, (model, frames));
            }
            let Some((model, frames)) = by_network.get(network) else {
                continue;
            };
            let thresholds = asked(chosen);
            let output = method_output(
                method,
                &ImprovedSettings::default(),
                model,
                set,
                frames,
                Some(&thresholds),
                &|| (),
            )?;
            let last = output.thresholds.len().saturating_sub(1);
            let judged = frames.iter().zip(&output.objects).map(|(frame, objects)| {
                let objects = objects[last]
                    .iter()
                    .map(|o| o.to_detection(&output.classes));
                frame.truth.with(&objects.collect::<Vec<_>>())
            });
            found.entry(method).or_default().push(judged.collect());
        }
    }
    let mut rows = Vec::new();
    for (method, sets) in &found {
        let threshold = evaluated[method].first().map_or(0.0, |e| e.threshold);
        for (folder, frames) in folders.iter().zip(sets) {
            rows.push(row(method, &tail(folder), threshold, frames)?);
        }
        if sets.len() > 1 {
            rows.push(row(method, "pooled", threshold, &sets.concat())?);
        }
    }
    Ok(rows)
}

/// The closed set first, as every method has it, then the chosen threshold.
fn asked(chosen: &Evaluated) -> Vec<f64> {
    let closed = chosen.curve.first().map_or(0.0, |point| point.threshold);
    if closed == chosen.threshold {
        vec![closed]
    } else {
        vec![closed, chosen.threshold]
    }
}

/// The last two parts of a path: they tell folders apart without telling where they lie.
fn tail(folder: &Path) -> String {
    let parts: Vec<_> = folder.iter().map(|part| part.to_string_lossy()).collect();
    parts[parts.len().saturating_sub(2)..].join("/")
}

fn row(
    method: &str,
    data: &str,
    threshold: f64,
    frames: &[Frame],
) -> Result<RealRow, ReproduceError> {
    let [literal, fair] =
        [UnknownProtocol::Literal, UnknownProtocol::Fair].map(|protocol| reports(frames, protocol));
    let entry = |class: &ClassReport| *class.entry(Metric::Space, Difficulty::Moderate);
    let entries: Vec<_> = literal?
        .iter()
        .map(|class| (class.rule.name.clone(), entry(class)))
        .collect();
    Ok(RealRow {
        method: method.to_owned(),
        data: data.to_owned(),
        frames: frames.len(),
        threshold,
        ap_all: entries
            .iter()
            .map(|(name, e)| (name.clone(), e.ap.all))
            .collect(),
        ap_unknown_fair: fair?.last().map(|class| entry(class).ap.all),
        labels: entries
            .iter()
            .map(|(name, e)| (name.clone(), e.truth_count))
            .collect(),
        recall_unknown: entries.last().map_or(0.0, |(_, e)| e.recall_percent),
    })
}

/// The known classes, then the unknown one.
fn reports(
    frames: &[Frame],
    protocol: UnknownProtocol,
) -> Result<Vec<ClassReport>, ReproduceError> {
    let request = RuleRequest {
        classes: IOU_MIN
            .iter()
            .map(|(class, _)| (*class).to_owned())
            .collect(),
        iou_min: IOU_MIN
            .iter()
            .map(|(class, iou)| ((*class).to_owned(), *iou))
            .collect(),
        unknown: Some(UnknownRequest {
            classes: unknown_classes("kitti"),
            iou_min: UNKNOWN_IOU_MIN,
            protocol,
        }),
        neighbours: NeighbourPolicy::Official,
    };
    Ok(evaluate(frames, &rules(&request, frames)?).classes)
}
