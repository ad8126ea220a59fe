//! `mluc-contract`: our refiners and the examples in Python and C++ pass; a program with a fault does not.

use mluc_tests::{
    Finished, Running, Setting, cpp_example, python_example, python_script, untrained_model,
};
use serde_json::Value;
use std::{process::Command, time::Duration};

/// `mluc-contract KIND OPTIONS`; for a refiner a model is added before the options.
fn contract(kind: &str, options: &[&str]) -> Finished {
    let folder = tempfile::tempdir().expect("a folder");
    let mut program = Command::new(env!("CARGO_BIN_EXE_mluc-contract"));
    program.arg(kind);
    if kind == "refiner" {
        program.arg("--model").arg(untrained_model(folder.path()));
    }
    Running::start(program.args(options)).finish_within(Duration::from_secs(600))
}

/// Exit code and reports, one per program.
fn suite(kind: &str, options: &[&str]) -> (Option<i32>, Vec<Value>) {
    let run = contract(kind, &[&["--json"], options].concat());
    let reports = run.lines.first().and_then(Value::as_array);
    let reports = reports.unwrap_or_else(|| panic!("no list of reports: {}", run.log));
    (run.code, reports.clone())
}

/// Exit code and report of one program.
fn suite_of(kind: &str, options: &[&str], command: &[String]) -> (Option<i32>, Value) {
    let command: Vec<&str> = command.iter().map(String::as_str).collect();
    let (code, mut reports) = suite(kind, &[options, &["--"], &command].concat());
    assert_eq!(reports.len(), 1);
    (code, reports.remove(0))
}

#[test]
fn our_refiner_passes_in_every_mode() {
    let (code, reports) = suite("refiner", &[]);
    for report in &reports {
        assert_eq!(report["failed"], 0, "{report:#}");
        assert_eq!(report["passed"], 18, "{report:#}");
        let text = |case: &str| {
            let cases = report["cases"].as_array().expect("cases");
            cases.iter().find(|c| c["name"] == case).expect("the case").to_string()
        };
        // Our refiners also do what the contract leaves open.
        for (case, said) in [
            ("scene", "health counts the candidates"),
            ("sent_again", "the same objects"),
            ("garbage_numbers", "34 survived: 0 refused"),
        ] {
            assert!(text(case).contains(said), "{case}: {}", text(case));
        }
    }
    assert_eq!(code, Some(0));
    assert_eq!(reports.len(), 4, "one report a variant");
}

/// Examples of refiners are tested in `foreign_refiners`, through `mluc refiner-test`.
fn examples_pass(kind: &str, input: &[String], cases: u64) {
    let examples = [python_example(kind), cpp_example(kind)];
    for command in examples.into_iter().flatten() {
        let (code, report) = suite_of(kind, &[], &[&command[..], input].concat());
        assert_eq!(code, Some(0), "{report:#}");
        assert_eq!(report["passed"], cases, "{report:#}");
    }
}

#[test]
fn the_sources_pass() {
    let setting = Setting::new("suites", 40);
    examples_pass("source", &[setting.input.display().to_string()], 9);
}

#[test]
fn the_consumers_pass() {
    examples_pass("consumer", &[], 11);
}

/// A sound program passes. A program with one of `faults` (the fault, the case that must find it, words of the reason) does not.
fn is_found_out(kind: &str, faults: &str) {
    let Some(script) = python_script(&format!("tests/contract/tests/wrong_{kind}.py")) else {
        return;
    };
    let of = |fault: &str, options: &[&str]| {
        suite_of(kind, options, &[&script[..], &[fault.to_string()]].concat())
    };
    let (code, report) = of("sound", &[]);
    let found = (code, &report["failed"]);
    assert_eq!(found, (Some(0), &Value::from(0)), "{report:#}");
    let is_found = |line: &str| {
        let words: Vec<&str> = line.split(" | ").collect();
        let [fault, case, word]: [&str; 3] = words.try_into().expect(line);
        let (code, report) = of(fault, &["--case", case, "--patience-s", "4"]);
        let found = &report["cases"][0];
        let what = found["what"].as_str().unwrap_or_default();
        let is_found = code == Some(1)
            && found["name"] == case
            && found["passed"] == false
            && what.contains(word);
        assert!(is_found, "{fault}: no '{word}' in: {report:#}");
    };
    // Most of the time they wait.
    let lines: Vec<&str> = faults.lines().collect();
    std::thread::scope(|scope| {
        for lines in lines.chunks(lines.len().div_ceil(3)) {
            scope.spawn(|| lines.iter().copied().for_each(is_found));
        }
    });
}

#[test]
fn a_refiner_with_a_fault_is_found_out() {
    is_found_out("refiner", include_str!("faults_refiner.txt"));
}

#[test]
fn a_source_with_a_fault_is_found_out() {
    is_found_out("source", include_str!("faults_source.txt"));
}

#[test]
fn a_consumer_with_a_fault_is_found_out() {
    is_found_out("consumer", include_str!("faults_consumer.txt"));
}

#[test]
fn a_program_that_is_none_fails_and_says_so() {
    for program in ["/nowhere/refiner", "pythno", "false"] {
        let (code, report) = suite_of("refiner", &["--patience-s", "2"], &[program.to_string()]);
        assert_eq!(code, Some(1), "{report}");
        let counts = ["passed", "failed", "not_run"].map(|key| report[key].as_u64());
        assert_eq!(counts, [Some(0), Some(1), Some(17)], "{report}");
        let what = report["cases"][0]["what"].as_str().expect("a reason");
        assert!(what.contains(program) || program == "false", "{what}");
    }
}

#[test]
fn an_unknown_case_is_a_usage_error() {
    let run = contract("refiner", &["--case", "overlod"]);
    run.assert_ended(2, 0);
    run.assert_says(&["--case: expected one of start, ", "found overlod"]);
}
