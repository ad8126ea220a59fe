//! Average precision against KITTI's own object devkit (C++).

use mluc_evaluate::input::{Source, read};
use mluc_evaluate::{RuleRequest, evaluate, rules};
use mluc_tests::oracle;

#[test]
fn oracle_kitti_eval_agrees_within_0_01() {
    let Some(folder) = oracle() else { return };
    let folder = folder.join("kitti_eval");
    let text = std::fs::read_to_string(folder.join("expected.json")).expect("expected.json");
    let expected: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let source = Source {
        labels: folder.join("label_2"),
        detections: folder.join("detections"),
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
            let (figure, ours) = (
                figure.as_f64().expect("a number"),
                found[key][name].as_f64(),
            );
            let ours =
                ours.unwrap_or_else(|| panic!("{key} {name}: expected {figure}, found nothing"));
            worst = worst.max((ours - figure).abs());
            assert!(
                (ours - figure).abs() <= 0.01,
                "{key} {name}: expected {figure}, found {ours}"
            );
        }
    }
    println!(
        "{} frames, {} entries, worst difference {worst:.5}",
        input.frames.len(),
        entries.len()
    );
}
