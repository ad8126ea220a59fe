//! Tests the command line alone: they start no pipeline.

use std::process::{Command, Output};

fn mluc(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_mluc")).args(arguments).output().expect("mluc starts")
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Exit code 2 of docs/output.md, with words that name the error.
#[test]
fn a_wrong_command_line_or_configuration_is_a_usage_error() {
    let folder = tempfile::tempdir().expect("a folder");
    let refused = |arguments: &[&str], words: &str| {
        let output = mluc(arguments);
        let said = said(&output);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(output.stdout.is_empty());
        assert!(said.contains(words), "{arguments:?}: {said}");
    };
    for case in include_str!("refused.txt").lines() {
        let (line, words) = case.split_once(" | ").expect("arguments and words");
        refused(&line.split(' ').collect::<Vec<_>>(), words);
    }
    let path = folder.path().join("mluc.toml");
    for case in include_str!("refused_settings.txt").lines() {
        let (text, words) = case.split_once(" | ").expect("settings and words");
        std::fs::write(&path, text.replace("\\n", "\n")).expect("written");
        refused(&["up", "--config", &path.to_string_lossy()], words);
    }
}

/// Rust replaces a closed stdout with /dev/null: results would be lost with exit code 0.
#[test]
fn a_closed_standard_output_is_an_error() {
    let program = env!("CARGO_BIN_EXE_mluc");
    let run = |redirection: &str| {
        let line = format!("exec '{program}' config --print {redirection}");
        Command::new("sh").args(["-c", &line]).output().expect("a shell")
    };
    let output = run(">&-");
    assert_eq!(output.status.code(), Some(1));
    assert!(said(&output).contains("standard output is closed"));
    assert_eq!(run(">/dev/null").status.code(), Some(0));
    assert_eq!(run("<&-").status.code(), Some(0));
}

#[test]
fn doctor_finds_few_open_files_and_segments_without_an_instance() {
    let (user, process) = (rustix::process::geteuid().as_raw(), std::process::id());
    let lost = format!("/dev/shm/mluc-{user}-lost-{process}.1.data");
    std::fs::write(&lost, "").expect("shared memory");
    let program = env!("CARGO_BIN_EXE_mluc");
    let line = format!("ulimit -n 900; exec '{program}' doctor");
    let output = Command::new("sh").args(["-c", &line]).output();
    std::fs::remove_file(&lost).expect("still there");
    let output = output.expect("a shell");
    let text = String::from_utf8_lossy(&output.stdout);
    let has_failed = text.contains("FAILURE");
    assert_eq!(output.status.code(), Some(i32::from(has_failed)), "{text}");
    let has =
        |words: &str| text.lines().any(|line| line.starts_with("warning") && line.contains(words));
    assert!(has("open files (ulimit -n): 900"), "{text}");
    assert!(has(&format!("mluc-{user}-* of no instance")), "{text}");
}

#[test]
fn status_of_nothing_is_a_failure() {
    for command in ["status --instance nobody-has-this", "top --once --instance nobody-has-this"] {
        let output = mluc(&command.split(' ').collect::<Vec<_>>());
        assert_eq!(output.status.code(), Some(1), "{command}");
        assert!(said(&output).contains("no pipeline of yours is named 'nobody-has-this'"));
    }
}

#[test]
fn a_stage_whose_supervisor_is_gone_does_not_start() {
    // Process 1 is not the parent here.
    let output = mluc(&["stage", "head", "--supervised-by=1", "--instance=gone"]);
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    assert!(said(&output).contains("the supervisor (process 1) is gone"));
}

#[test]
fn nothing_stays_of_a_standard_input() {
    let folder = tempfile::tempdir().expect("a folder");
    // The folder that a killed process left.
    std::fs::create_dir(folder.path().join("mluc-stdin-1")).expect("a folder");
    let mut doctor = Command::new(env!("CARGO_BIN_EXE_mluc"));
    doctor.args(["doctor", "--input", "-"]);
    let output = doctor.env("TMPDIR", folder.path()).output().expect("mluc starts");
    assert!(said(&output).contains("found nothing"), "{}", said(&output));
    assert_eq!(folder.path().read_dir().expect("a folder").count(), 0);
}
