//! Wrong keys in a scenario, a stage that never answers, reports of another version: a clear error comes at once.

use mluc_tests::{Finished, Running, Setting, write_file};
use serde_json::json;
use std::{path::Path, time::Duration};

/// `mluc bench` with words as on a command line.
fn bench(words: &str) -> Finished {
    let words = ["bench"].into_iter().chain(words.split_whitespace());
    Running::mluc(words).finish_within(Duration::from_secs(120))
}

/// `mluc bench` with a scenario.
fn with_scenario(folder: &Path, scenario: &str, options: &str) -> Finished {
    let [file, out] = ["scenario.toml", "report"].map(|name| folder.join(name));
    std::fs::write(&file, scenario).unwrap();
    let (file, out) = (file.display(), out.display());
    bench(&format!("--scenario {file} --out {out} {options}"))
}

#[test]
fn what_the_machine_does_not_have_is_refused_before_anything_runs() {
    let folder = tempfile::tempdir().unwrap();
    for (line, words) in [
        ("stages.backbone.cpus = [4000]", "cpus of backbone, 4000"),
        ("[stages.head]\npriority = 200", "priority of head, 1 to 99"),
        ("pace = \"complete\"", "open loop"),
        ("[bench]\nsecond = 3", "second, did you mean `seconds`?"),
        ("[bench]\nseconds = -1", "seconds must be, -1"),
        ("[bench]\nrounds = 0", "rounds must be"),
        ("model = \"nowhere.safetensors\"", "nowhere.safetensors"),
    ] {
        let run = with_scenario(folder.path(), line, "");
        assert!(matches!(run.code, Some(1 | 2)), "{line}: {run:?}");
        assert!(run.lines.is_empty());
        run.assert_says(&words.split(", ").collect::<Vec<_>>());
    }
    let refiners = "--refiner none --refiner depth --refiner none";
    for options in ["--refiner distnace", refiners, "--rate 0"] {
        let run = bench(options);
        assert_eq!(run.code, Some(2), "{options}: {}", run.log);
    }
}

#[test]
fn a_stage_that_never_answers_is_named() {
    let setting = Setting::new("silent", 2);
    let scenario = format!(
        "model = {:?}\ninput = {:?}\n[stages.refiner]\ncommand = [\"sleep\", \"1000\"]",
        setting.model, setting.input
    );
    let run = with_scenario(setting.folder.path(), &scenario, "--patience 4");
    assert_eq!(run.code, Some(1), "{}", run.log);
    run.assert_says(&["no objects came within 4 s", "refiner is silent"]);
}

#[test]
fn reports_that_cannot_be_judged_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().display();
    let report = json!({"report_version": 99}).to_string();
    write_file(&folder.path().join("report.json"), report);
    for (other, words) in [
        (path.to_string(), "report version 99, expected 1"),
        (format!("{path}/nowhere"), "no report of `mluc bench`"),
    ] {
        let run = bench(&format!("compare --json {other} {other}"));
        assert_eq!(run.code, Some(1), "{other}");
        run.assert_says(&[words]);
    }
}
