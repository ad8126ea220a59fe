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

/// Exit code 2 of docs/output.md, with words that name the fault.
#[test]
fn a_wrong_command_line_or_configuration_is_a_usage_error() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).expect("written");
        format!("--config={}", path.display())
    };
    let (typo, negative) = (
        file("a.toml", "\nmodle = 1"),
        file("b.toml", "[refiner]\npoints_min = -1"),
    );
    let nowhere = format!("--config={}/nope.toml", folder.path().display());
    for (arguments, words) in [
        (&["upp"][..], "'up'"),
        (&["up", "--pace", "fast"], "sensor"),
        (&["up", "--lambda", "much"], "--lambda"),
        (&["up"], "--input is missing"),
        (&["config", "--model", "kitt"], "did you mean 'kitti'?"),
        (&["doctor", "--instance"], "--instance"),
        (
            &["config", "--model", "kitti-open", "--lambda", "1.2"],
            "--unknown-min",
        ),
        (
            &["config", "--model", "kitti", "--unknown-min", "0.5"],
            "--lambda",
        ),
        (&["config", "--precision", "fp32"], "did you mean 'f32'?"),
        (&["config", &typo], "line 2"),
        (&["config", &typo], "did you mean `model`?"),
        (&["up", &negative], "points_min"),
        (&["config", &nowhere], "nope.toml"),
        (&["stage", "bakcbone"], "did you mean 'backbone'?"),
        (&["status", "--instance", "a/b"], "a/b"),
    ] {
        let output = mluc(arguments);
        let said = said(&output);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(output.stdout.is_empty());
        assert!(said.contains(words), "{arguments:?}: {said}");
        assert_eq!(said.matches("precision:").count(), 0, "{said}");
    }
}

#[test]
fn what_the_file_may_hold_is_shown_with_its_origin() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("mluc.toml");
    std::fs::write(&path, "track = true\nloop = true\nseconds = 3.0\n").expect("written");
    let config = format!("--config={}", path.display());
    let output = mluc(&["config", "--print", &config, "--pace", "complete"]);
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    for (key, origin) in [
        ("loop = true ", "# file "),
        ("seconds = 3.0 ", "# file "),
        ("pace = \"complete\"", "# flag"),
        ("unknown_min = ", "# model"),
        ("[track]", "[track]"),
    ] {
        let line = text.lines().find(|line| line.starts_with(key));
        assert!(
            line.is_some_and(|line| line.contains(origin)),
            "{key}: {text}"
        );
    }
}

/// Rust opens /dev/null in its place: results would be lost with exit code 0.
#[test]
fn a_closed_standard_output_is_an_error() {
    let program = env!("CARGO_BIN_EXE_mluc");
    let run = |redirection: &str| {
        let line = format!("exec '{program}' config --print {redirection}");
        Command::new("sh")
            .args(["-c", &line])
            .output()
            .expect("a shell")
    };
    let output = run(">&-");
    assert_eq!(output.status.code(), Some(1));
    assert!(said(&output).contains("standard output is closed"));
    assert_eq!(run(">/dev/null").status.code(), Some(0));
    assert_eq!(run("<&-").status.code(), Some(0));
}

#[test]
fn doctor_warns_without_a_failure() {
    let output = mluc(&["doctor"]);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let failed = text.contains("FAILURE");
    assert_eq!(output.status.code(), Some(i32::from(failed)), "{text}");
}

#[test]
fn help_names_every_command() {
    let output = mluc(&["--help"]);
    assert_eq!(output.status.code(), Some(0));
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    for command in ["up", "demo", "stage", "config", "status", "doctor"] {
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
