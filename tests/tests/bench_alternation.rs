//! Two refiners on the same frames in alternation; instrumentation on against off.

use std::path::Path;
use std::time::Duration;

use mluc_tests::{Finished, Pipeline, clean_folder, untrained_model};
use serde_json::Value;

fn bench(folder: &Path, out: &Path, more: &[&str]) -> Finished {
    let (model, input) = (untrained_model(folder), clean_folder(folder, 2));
    let paths = [&model, &input, out].map(|path| path.display().to_string());
    let mut arguments = vec![
        "bench",
        "--model",
        &paths[0],
        "--input",
        &paths[1],
        "--out",
        &paths[2],
        "--seconds",
        "4",
        "--warm-up",
        "0.5",
        "--rate",
        "8",
        "--rounds",
        "2",
        "--floor-rounds",
        "0",
    ];
    arguments.extend(more);
    Pipeline::start(&arguments).finish_within(Duration::from_secs(180))
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).expect("written")).expect("JSON")
}

/// A label on the car that `car_scan` draws in each scan, which the model does not call a car.
fn label_all(input: &Path) {
    let folder = input.parent().unwrap().join("label_2");
    std::fs::create_dir_all(&folder).unwrap();
    for number in 0..2 {
        let forward = 8.0 + f64::from(number);
        let line = format!("Forklift 0 0 0 0 0 1 1 1.5 1.8 1.0 0.0 1.6 {forward} 0.0\n");
        std::fs::write(folder.join(format!("{number:06}.txt")), line).unwrap();
    }
}

#[test]
fn two_refiners_are_judged_on_the_same_frames() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report");
    label_all(&folder.path().join("scans"));
    let run = bench(
        folder.path(),
        &out,
        &["--refiner", "none", "--refiner", "distance"],
    );
    assert!(matches!(run.code, Some(0 | 3)), "{}", run.log);
    let comparison = json(&out.join("comparison.json"));
    assert_eq!(comparison["names"], serde_json::json!(["none", "distance"]));
    for quality in comparison["quality"].as_array().unwrap() {
        assert_eq!(
            (&quality["frames"], &quality["labels_unknown"]),
            (&2.into(), &2.into()),
            "{comparison}"
        );
    }
    let [a, b] = ["a", "b"].map(|name| json(&out.join(name).join("report.json")));
    assert_eq!(
        (&a["scenario"]["refiner"], &b["scenario"]["refiner"]),
        (&"none".into(), &"distance".into())
    );
    assert_eq!(a["frames"]["in"], b["frames"]["in"]);
    // Only where no box is refined does this untrained model publish unknown objects: the tables are those of two refiners.
    let published = |turn: usize| {
        comparison["quality"][turn]["unknown_per_frame"]
            .as_f64()
            .unwrap()
    };
    assert!(published(0) > published(1), "{comparison}");
    let terminal: String = run
        .lines
        .iter()
        .filter_map(Value::as_str)
        .collect::<Vec<_>>()
        .join("\n");
    assert!(
        terminal.contains("3-D overlap") && terminal.contains("refiner run p50"),
        "{terminal}"
    );
    let page = std::fs::read_to_string(out.join("b/report.html")).unwrap();
    assert!(page.contains("of round 1"), "each had two rounds");
}

#[test]
fn bare_stages_stamp_nothing_and_only_the_end_is_compared() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report");
    let run = bench(folder.path(), &out, &["--instrumentation", "compare"]);
    assert!(matches!(run.code, Some(0 | 3)), "{}", run.log);
    let [on, off] = ["a", "b"].map(|name| json(&out.join(name).join("report.json")));
    assert_eq!(
        (
            &on["instrumentation"]["stamps"],
            &on["instrumentation"]["spans"]
        ),
        (&"on".into(), &"on".into())
    );
    assert_eq!(
        (
            &off["instrumentation"]["stamps"],
            &off["instrumentation"]["spans"]
        ),
        (&"off".into(), &"off".into())
    );
    assert!(on["stages"]["backbone"]["run_us"]["p50"].as_f64().unwrap() > 0.0);
    assert_eq!(off["stages"]["backbone"]["run_us"]["p50"], 0.0);
    assert!(
        off["end_to_end_us"]["p50"].as_f64().unwrap() > 0.0,
        "the end is still measured"
    );
    let rows = json(&out.join("comparison.json"))["rows"].clone();
    let figures: Vec<&str> = rows
        .as_array()
        .unwrap()
        .iter()
        .filter_map(|row| row["figure"].as_str())
        .collect();
    assert!(
        figures
            .iter()
            .all(|name| name.starts_with("end to end") || name.starts_with("frames")),
        "{figures:?}"
    );
}
