//! The command line alone: no pipeline is started here.

use std::process::{Command, Output};

fn mluc(arguments: &[&str]) -> Output {
    let program = env!("CARGO_BIN_EXE_mluc");
    Command::new(program)
        .args(arguments)
        .output()
        .expect("mluc starts")
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn a_wrong_command_line_is_a_usage_error() {
    for arguments in [
        &["upp"][..],
        &["up", "--pace", "fast"],
        &["up", "--model", "x", "--lambda", "much"],
        &["up"],
        &["stage", "bakcbone"],
        &["status", "--instance", "a/b"],
    ] {
        let output = mluc(arguments);
        assert_eq!(
            output.status.code(),
            Some(2),
            "{arguments:?}: {}",
            said(&output)
        );
        assert!(output.stdout.is_empty());
        assert!(!said(&output).is_empty());
    }
    assert!(said(&mluc(&["stage", "bakcbone"])).contains("did you mean 'backbone'?"));
}

#[test]
fn help_names_every_command() {
    let output = mluc(&["--help"]);
    assert_eq!(output.status.code(), Some(0));
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    for command in ["up", "demo", "stage", "status", "doctor"] {
        assert!(text.contains(command), "{command}: {text}");
    }
}

#[test]
fn status_of_nothing_is_a_failure() {
    let output = mluc(&["status", "--instance", "nobody-has-this"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(said(&output).contains("no pipeline runs under the name 'nobody-has-this'"));
}

#[test]
fn a_stage_whose_supervisor_is_gone_does_not_start() {
    // Process 1 is not our parent here.
    let output = mluc(&[
        "stage",
        "head",
        "--supervised-by",
        "1",
        "--instance",
        "gone",
    ]);
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    assert!(said(&output).contains("the supervisor (process 1) is gone"));
}
