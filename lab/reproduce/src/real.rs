//! Rows on recorded scans, with networks and thresholds from simulated scans only: nothing is chosen on recorded scans.

use crate::methods::{METHODS, MethodInput, MethodRow, run_method};
use crate::{Result, Setting, evaluate::read_model, layout::Layout};
use crate::{evaluated::ByRow, evaluated::Evaluated, options::Screen, options::TestFrames};
use mluc_backbone::Precision;
use mluc_evaluate::pipeline::{FrameSet, detect_frames, folder_tail, unknown_classes};
use mluc_evaluate::{ClassReport, ClassRule, LabelledFrame};
use mluc_evaluate::{UNKNOWN_IOUS, UnknownProtocol, evaluate};
use serde_json::{Value, json};
use std::{collections::BTreeMap, path::PathBuf};

/// Overlaps on recorded scans: smaller than KITTI's, since simulated boxes differ from annotated ones.
const IOU_MIN: [(&str, f64); 3] = [("car", 0.5), ("pedestrian", 0.25), ("cyclist", 0.25)];

/// Every evaluated row of the simulated setting on each folder separately, and on all folders pooled.
pub(crate) fn real_rows(
    layout: &Layout,
    test: &TestFrames,
    evaluated: &ByRow,
    folders: &[PathBuf],
    screen: &dyn Screen,
) -> Result<Vec<Value>> {
    if test.setting != Setting::SimKitti {
        return Ok(Vec::new());
    }
    let first = evaluated.iter().filter_map(|(key, seeds)| {
        let row = METHODS.iter().find(|row| row.key == **key)?;
        Some((row, seeds.first()?, Vec::new()))
    });
    let mut found: Vec<(&MethodRow, &Evaluated, Vec<Vec<LabelledFrame>>)> = first.collect();
    for folder in folders {
        let set = FrameSet::open(folder, None, usize::MAX)?;
        let mut by_network = BTreeMap::new();
        for (row, chosen, judged) in &mut found {
            let name = row.network.name();
            if !by_network.contains_key(&name) {
                let model = read_model(layout, (test.setting, row.network, chosen.seed))?;
                screen.count("recorded scans", set.names().len() as u64);
                let step = || screen.tick();
                let frames = detect_frames(Precision::default(), &model, &set, step)?;
                by_network.insert(name.clone(), (model, frames));
            }
            let (model, frames) = &by_network[&name];
            // The closed set first, as in every method.
            let closed = chosen.curve.first().map_or(0.0, |point| point.threshold);
            let mut asked = vec![closed, chosen.threshold];
            asked.dedup();
            let input =
                MethodInput { asked: Some(&asked), ..MethodInput::new(model, &set, frames) };
            let output = run_method(row.method, &input)?;
            let last = output.thresholds.len().saturating_sub(1);
            judged.push(output.labelled(frames, last));
        }
    }
    let mut rows = Vec::new();
    for (row, chosen, judged) in found {
        let mut add = |data: &str, frames: &[LabelledFrame]| {
            rows.push(real_row(&row.key, data, chosen.threshold, frames));
        };
        for (folder, frames) in folders.iter().zip(&judged) {
            add(&folder_tail(folder), frames);
        }
        if judged.len() > 1 {
            add("pooled", &judged.concat());
        }
    }
    Ok(rows)
}

/// AP over all points, moderate, by class. `fair`: trams, Misc, sitting persons and objects in DontCare regions are neither right nor wrong.
fn real_row(method: &str, data: &str, threshold: f64, frames: &[LabelledFrame]) -> Value {
    let [literal, fair] =
        [UnknownProtocol::Literal, UnknownProtocol::Fair].map(|protocol| reports(frames, protocol));
    let by_class = || literal.iter().map(|c| (c.rule.name.clone(), c.main()));
    let unknown = |report: &[ClassReport]| report.last().map(|c| *c.main());
    json!({
        "method": method, "data": data, "frames": frames.len(), "threshold": threshold,
        "ap_all": by_class().map(|(name, e)| (name, e.ap.all)).collect::<BTreeMap<_, _>>(),
        "ap_unknown_fair": unknown(&fair).map(|e| e.ap.all),
        "labels": by_class().map(|(name, e)| (name, e.truth_count)).collect::<BTreeMap<_, _>>(),
        "recall_unknown": unknown(&literal).map_or(0.0, |e| e.recall_percent),
    })
}

/// The known classes, then the unknown one.
fn reports(frames: &[LabelledFrame], protocol: UnknownProtocol) -> Vec<ClassReport> {
    let known = |(class, iou): (&str, f64)| ClassRule::known(class, iou);
    let mut rules: Vec<ClassRule> = IOU_MIN.into_iter().map(known).collect();
    let unknown = unknown_classes("kitti");
    rules.push(ClassRule::unknown(&unknown, UNKNOWN_IOUS[0], protocol));
    evaluate(frames, &rules).classes
}
