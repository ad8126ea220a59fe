//! Two refiners on the same frames in alternation; instrumentation on against off.

use std::path::Path;

use mluc_tests::{Setting, assert_has, mluc_program, read_json, write_file};
use serde_json::{Value, json};

/// Options of a short run, each side in turns.
const SHORT: &str = "--seconds 4 --warm-up 0.5 --rate 8 --rounds 2 --floor-rounds 0";

/// Of both sides.
fn reports(out: &Path) -> [Value; 2] {
    ["a", "b"].map(|side| read_json(&out.join(side).join("report.json")))
}

/// A label on the car that `car_scan` draws in each scan, which the model does not call a car.
fn label_all(input: &Path) {
    for number in 0..2 {
        let forward = 8.0 + f64::from(number);
        let line = format!("Forklift 0 0 0 0 0 1 1 1.5 1.8 1.0 0.0 1.6 {forward} 0.0\n");
        let label = format!("label_2/{number:06}.txt");
        write_file(&input.with_file_name(label), line);
    }
}

#[test]
fn two_refiners_are_judged_on_the_same_frames() {
    let setting = Setting::new("bench", 2);
    let out = setting.report();
    label_all(&setting.input);
    let run = setting.bench(&format!("{SHORT} --refiner none --refiner range-scaled"));
    let comparison = read_json(&out.join("comparison.json"));
    assert_eq!(comparison["names"], json!(["none", "range-scaled"]));
    let quality = comparison["quality"].as_array().unwrap();
    for key in ["frames", "labels_unknown"] {
        assert!(quality.iter().all(|side| side[key] == 2), "{comparison}");
    }
    let [a, b] = reports(&out);
    assert_eq!(a["scenario"]["refiner"], "none");
    assert_eq!(b["scenario"]["refiner"], "range-scaled");
    assert_eq!(a["frames"]["in"], b["frames"]["in"]);
    // Only where no box is refined does this untrained model publish unknown objects: the tables are those of two refiners.
    let published = |side: usize| quality[side]["unknown_per_frame"].as_f64().unwrap();
    assert!(published(0) > published(1), "{comparison}");
    let terminal = run.text();
    assert_has(&terminal, &["3-D overlap", "refiner run p50"]);
    let page = std::fs::read_to_string(out.join("b/report.html")).unwrap();
    assert!(page.contains("of round 1"), "each had two rounds");
}

#[test]
fn two_builds_are_measured_by_their_own_programs() {
    let setting = Setting::new("bench", 2);
    let out = setting.report();
    let program = mluc_program().display().to_string();
    setting.bench(&format!("{SHORT} --against {program}"));
    let comparison = read_json(&out.join("comparison.json"));
    assert_eq!(comparison["names"][1], program);
    for (side, report) in ["a", "b"].into_iter().zip(reports(&out)) {
        // 4 s at 8 Hz, over two starts.
        assert_eq!(report["frames"]["in"], 32, "{side}");
        assert!(!report["build"]["binary"].as_str().unwrap().is_empty());
        let page = std::fs::read_to_string(out.join(side).join("report.html")).unwrap();
        assert!(page.contains("of round 1"), "each had two rounds");
    }
}

#[test]
fn bare_stages_stamp_nothing_and_only_the_end_is_compared() {
    let setting = Setting::new("bench", 2);
    let out = setting.report();
    setting.bench(&format!("{SHORT} --instrumentation compare"));
    let [on, off] = reports(&out);
    for what in ["stamps", "spans"] {
        assert_eq!(on["instrumentation"][what], "on");
        assert_eq!(off["instrumentation"][what], "off");
    }
    assert!(on["stages"]["backbone"]["run_us"]["p50"].as_f64().unwrap() > 0.0);
    assert_eq!(off["stages"]["backbone"]["run_us"]["p50"], 0.0);
    let p50_us = off["end_to_end_us"]["p50"].as_f64().unwrap();
    assert!(p50_us > 0.0, "the end is still measured");
    for row in read_json(&out.join("comparison.json"))["rows"]
        .as_array()
        .unwrap()
    {
        let figure = row["figure"].as_str().unwrap();
        let mut starts = ["end to end", "frames"].iter();
        assert!(starts.any(|start| figure.starts_with(start)), "{figure}");
    }
}
