//! `mluc-contract refiner`: our refiners pass, a program with a fault does not.

use std::process::Command;
use std::time::Duration;

use mluc_tests::{Finished, Running, built_program, untrained_model};
use serde_json::Value;

/// `mluc-contract refiner ARGUMENTS`.
fn refiner(arguments: &[&str]) -> Finished {
    let mut program = Command::new(env!("CARGO_BIN_EXE_mluc-contract"));
    let run = Running::start(program.arg("refiner").args(arguments));
    run.finish_within(Duration::from_secs(600))
}

/// Exit code and reports.
fn suite(arguments: &[&str]) -> (Option<i32>, Vec<Value>) {
    let folder = tempfile::tempdir().expect("a writable folder");
    let model = untrained_model(folder.path()).display().to_string();
    let run = refiner(&[&["--json", "--model", &model], arguments].concat());
    let reports = run.lines.first().and_then(Value::as_array);
    let reports = reports.unwrap_or_else(|| panic!("no list of reports: {}", run.log));
    (run.code, reports.clone())
}

fn wrong_refiner(fault: &str, more: &[&str]) -> (Option<i32>, Value) {
    let program = built_program("examples/wrong_refiner");
    let program = program.display().to_string();
    let (code, mut reports) = suite(&[more, &["--", &program, fault]].concat());
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
    assert_eq!(code, Some(0), "{report:#}");
    assert_eq!(report["failed"], 0, "{report:#}");
}

/// What is wrong, the case that must find it, and a word of the reason.
const FAULTS: &str = include_str!("faults.txt");

#[test]
fn a_program_with_a_fault_is_found_out() {
    for line in FAULTS.lines() {
        let words: Vec<&str> = line.split(" | ").collect();
        let [fault, case, word] = words[..] else {
            panic!("{line}")
        };
        let more = ["--case", case, "--patience-s", "4"];
        let (code, report) = wrong_refiner(fault, &more);
        assert_eq!(code, Some(1), "{fault}: {report:#}");
        let found = &report["cases"][0];
        assert_eq!(found["name"], case, "{fault}");
        assert_eq!(found["passed"], false, "{fault}");
        let what = found["what"].as_str().expect("a reason");
        assert!(what.contains(word), "{fault}: no '{word}' in: {what}");
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
    let run = refiner(&["--case", "overlod"]);
    run.assert_ended(2, 0);
    run.assert_says(&["--case: expected one of start, ", "found overlod"]);
}
