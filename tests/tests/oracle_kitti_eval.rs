//! Compares average precision with KITTI's own object devkit (C++).

use mluc_evaluate::{RuleRequest, evaluate, input::Source, input::read, rules};
use mluc_tests::{oracle, read_json};

#[test]
fn oracle_kitti_eval_agrees_within_0_01() {
    let Some(folder) = oracle() else { return };
    let folder = folder.join("kitti_eval");
    let expected = read_json(&folder.join("expected.json"));
    let source = Source {
        labels: folder.join("label_2"),
        detections: folder.join("detections"),
        scans: None,
        calibration: None,
    };
    let input = read(&[source], None).expect("frames");
    assert!(input.warnings.is_empty(), "{:?}", input.warnings);
    let rules = rules(&RuleRequest::default(), &input.frames).expect("rules");
    let found = evaluate(&input.frames, &rules).to_json();
    let entries = expected.as_object().expect("an object");
    assert!(!entries.is_empty());
    let mut worst = 0.0f64;
    for (key, figures) in entries {
        for (name, figure) in figures.as_object().expect("figures") {
            let expected = figure.as_f64().expect("a number");
            let ours = found[key][name].as_f64();
            let difference = ours.map_or(f64::INFINITY, |ours| (ours - expected).abs());
            worst = worst.max(difference);
            let title = format!("{key} {name}");
            assert!(difference <= 0.01, "{title}: expected {expected}, found {ours:?}");
        }
    }
    let (frames, entries) = (input.frames.len(), entries.len());
    println!("{frames} frames, {entries} entries, worst difference {worst:.5}");
}
