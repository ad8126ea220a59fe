//! `mluc-contract refiner`: our refiners pass, a program with a fault does not.

use std::process::Command;

use mluc_tests::{built_program, untrained_model};
use serde_json::Value;

const PROGRAM: &str = env!("CARGO_BIN_EXE_mluc-contract");

/// Exit code and reports.
fn suite(arguments: &[&str]) -> (Option<i32>, Vec<Value>) {
    let folder = tempfile::tempdir().expect("a writable folder");
    let model = untrained_model(folder.path());
    let output = Command::new(PROGRAM)
        .args(["refiner", "--json", "--model"])
        .arg(&model)
        .args(arguments)
        .output()
        .expect("mluc starts");
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    let reports: Value = serde_json::from_slice(&output.stdout).unwrap_or_else(|_| {
        panic!("no JSON; stderr: {words}");
    });
    let reports = reports.as_array().expect("a list").clone();
    (output.status.code(), reports)
}

fn wrong_refiner(fault: &str, more: &[&str]) -> (Option<i32>, Value) {
    let mut arguments = more.to_vec();
    let program = built_program("examples/wrong_refiner")
        .display()
        .to_string();
    arguments.extend(["--", &program, fault]);
    let (code, mut reports) = suite(&arguments);
    assert_eq!(reports.len(), 1);
    (code, reports.remove(0))
}

#[test]
fn our_refiner_passes_in_every_mode() {
    let (code, reports) = suite(&[]);
    for report in &reports {
        assert_eq!(report["failed"], 0, "{report:#}");
        assert_eq!(report["passed"], 18, "{report:#}");
        let text = |case: &str| {
            let cases = report["cases"].as_array().expect("cases");
            let case = cases.iter().find(|c| c["name"] == case).expect("the case");
            case.to_string()
        };
        // What the contract leaves open, ours does.
        for (case, said) in [
            ("scene", "health counts the candidates"),
            ("sent_again", "the same objects"),
            ("garbage_numbers", "30 survived: 0 refused"),
        ] {
            assert!(text(case).contains(said), "{case}: {}", text(case));
        }
    }
    assert_eq!(code, Some(0));
    assert_eq!(reports.len(), 4, "one report a variant");
}

#[test]
fn a_sound_program_passes() {
    let (code, report) = wrong_refiner("sound", &[]);
    assert_eq!(
        (code, &report["failed"]),
        (Some(0), &Value::from(0)),
        "{report:#}"
    );
}

/// What is wrong, the case that must find it, and a word of the reason.
const FAULTS: [(&str, &str, &str); 20] = [
    ("no_health", "start", "heartbeat"),
    ("moves_known", "scene", "known"),
    ("forgets", "scene", "each has one"),
    ("renumbers", "scene", "no objects of frame"),
    ("forgets_run", "scene", "run"),
    ("any_sequence", "sequences", "answered"),
    ("any_run", "other_run", "answered"),
    ("not_finite", "scene", "not finite"),
    ("clockwise", "scene", "outline of a published object"),
    ("bad_index", "scene", "point of an object"),
    ("no_stamps", "scene", "stamps"),
    ("miscounts", "scene", "count the candidates"),
    ("no_points", "empty", "points_gone"),
    ("unflagged", "points_gone", "points_gone"),
    ("answers_once", "sent_again", "no objects of frame"),
    ("uncounted", "overload", "frames_dropped"),
    ("brittle", "garbage_numbers", "it ended"),
    ("any_version", "wrong_version", "answered"),
    ("silent", "silence", "heartbeat"),
    ("deaf", "stop", "still running"),
];

#[test]
fn a_program_with_a_fault_is_found_out() {
    for (fault, case, word) in FAULTS {
        let more = ["--case", case, "--patience-s", "4"];
        let (code, report) = wrong_refiner(fault, &more);
        assert_eq!(code, Some(1), "{fault}: {report:#}");
        let found = &report["cases"][0];
        assert_eq!(found["name"], case, "{fault}");
        assert_eq!(found["passed"], false, "{fault}");
        let what = found["what"].as_str().expect("a reason");
        assert!(
            what.contains(word),
            "{fault}: '{word}' is missing in: {what}"
        );
    }
}

#[test]
fn a_program_that_is_none_fails_and_says_so() {
    for program in ["/nowhere/refiner", "pythno", "false"] {
        let (code, reports) = suite(&["--patience-s", "2", "--", program]);
        let report = &reports[0];
        assert_eq!(code, Some(1), "{report}");
        let counts = ["passed", "failed", "not_run"].map(|key| report[key].as_u64());
        assert_eq!(counts, [Some(0), Some(1), Some(17)], "{report}");
        let what = report["cases"][0]["what"].as_str().expect("a reason");
        assert!(what.contains(program) || program == "false", "{what}");
    }
}

#[test]
fn an_unknown_case_is_a_usage_error() {
    let output = Command::new(PROGRAM)
        .args(["refiner", "--case", "overlod"])
        .output()
        .expect("mluc starts");
    assert_eq!(output.status.code(), Some(2));
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(
        words.contains("a similar value exists: 'overload'"),
        "{words}"
    );
}
