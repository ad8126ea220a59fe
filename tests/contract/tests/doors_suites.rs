//! `mluc-contract source` and `consumer`: the examples in Python and C++ pass, a program with a fault does not.

use std::process::Command;
use std::time::Duration;

use mluc_tests::{Running, Setting, cpp_example, python_example};
use serde_json::Value;

/// Exit code and report.
fn suite(kind: &str, options: &[&str], command: &[String]) -> (Option<i32>, Value) {
    let mut program = Command::new(env!("CARGO_BIN_EXE_mluc-contract"));
    program.args([kind, "--json"]).args(options).arg("--");
    let run = Running::start(program.args(command)).finish_within(Duration::from_secs(300));
    let report = run.lines.first().map(|reports| reports[0].clone());
    (run.code, report.unwrap_or_else(|| panic!("{}", run.log)))
}

fn passes(kind: &str, command: &[String], cases: usize) {
    let (code, report) = suite(kind, &[], command);
    assert_eq!(code, Some(0), "{report:#}");
    assert_eq!(report["passed"], cases, "{report:#}");
}

#[test]
fn the_examples_pass() {
    let setting = Setting::new("suites", 40);
    let scans = setting.input.display().to_string();
    for source in [python_example("source"), cpp_example("source")]
        .iter()
        .flatten()
    {
        passes(
            "source",
            &[&source[..], std::slice::from_ref(&scans)].concat(),
            9,
        );
    }
    for consumer in [python_example("consumer"), cpp_example("consumer")]
        .iter()
        .flatten()
    {
        passes("consumer", consumer, 11);
    }
}

/// `faults`: what is wrong, the case that must find it, and words of the reason.
fn is_found_out(kind: &str, faults: &str) {
    let Some(words) = python_example(kind) else {
        return;
    };
    let script = format!("{}/tests/wrong_{kind}.py", env!("CARGO_MANIFEST_DIR"));
    let program = |fault: &str| [words[0].clone(), script.clone(), fault.to_string()];
    let (code, report) = suite(kind, &[], &program("sound"));
    assert_eq!(
        (code, &report["failed"]),
        (Some(0), &Value::from(0)),
        "{report:#}"
    );
    for line in faults.lines() {
        let words: Vec<&str> = line.split(" | ").collect();
        let [fault, case, word] = words[..] else {
            panic!("{line}")
        };
        let options = ["--case", case, "--patience-s", "4"];
        let (code, report) = suite(kind, &options, &program(fault));
        let found = &report["cases"][0];
        let what = found["what"].as_str().unwrap_or_default();
        let is_found = code == Some(1) && found["name"] == case && what.contains(word);
        assert!(is_found, "{fault}: no '{word}' in: {report:#}");
    }
}

#[test]
fn a_source_with_a_fault_is_found_out() {
    is_found_out("source", include_str!("faults_source.txt"));
}

#[test]
fn a_consumer_with_a_fault_is_found_out() {
    is_found_out("consumer", include_str!("faults_consumer.txt"));
}
