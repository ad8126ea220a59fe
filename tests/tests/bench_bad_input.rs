//! What a scenario cannot have, a stage that never answers, reports of another version: said clearly, and at once.

use std::path::Path;
use std::time::Duration;

use mluc_tests::{Finished, Running, Setting, write_file};
use serde_json::json;

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
        (
            "[stages.backbone]\ncpus = [0, 4000]",
            "cpus of backbone, 4000",
        ),
        ("[stages.head]\npriority = 200", "priority of head, 1 to 99"),
        (
            "[bench.load]\nmemory_mib = 99999999",
            "memory_mib, available",
        ),
        ("[bench.load]\ncpu_threads = 100000", "cpu_threads, 1024"),
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
    for options in [
        "--refiner distnace",
        "--refiner none --refiner depth --refiner none",
        "--trace t.json --trace-frame slowest",
        "--trace t.json --rounds 3",
        "--rate 0",
    ] {
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

/// A report of `frames` synthetic frames.
fn write_report(folder: &Path, version: u32, frames: usize) {
    let report = json!({"report_version": version}).to_string();
    write_file(&folder.join("report.json"), report);
    let head = "round,sequence,frame,phase,outcome,due_us,ingest_received_us,ingest_started_us,ingest_published_us,\
                backbone_received_us,backbone_started_us,backbone_published_us,head_received_us,head_started_us,\
                head_published_us,refiner_received_us,refiner_started_us,refiner_published_us,arrived_us,latency_us,flags";
    let mut text = format!("{head}\n");
    for n in 0..frames {
        let due = n as f64 * 1e5;
        let stamps = (0..12).map(|k| format!(",{}", due + 1000.0 * f64::from(k)));
        let stamps: String = stamps.collect();
        text += &format!("0,{n},a,measured,out,{due}{stamps},{},11000,\n", due + 12e3);
    }
    std::fs::write(folder.join("frames.csv"), text).unwrap();
}

#[test]
fn reports_that_cannot_be_judged_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let compare = |other: &str| {
        let [good, other] = [at("good"), at(other)].map(|path| path.display().to_string());
        bench(&format!("compare --json {good} {other}"))
    };
    write_report(&at("good"), 1, 40);
    write_report(&at("future"), 99, 40);
    write_report(&at("short"), 1, 5);
    write_report(&at("cut"), 1, 40);
    std::fs::write(at("cut").join("frames.csv"), "round,sequence").unwrap();
    for (other, words) in [
        ("future", "report version 99, expected 1"),
        ("short", "5 measured frames"),
        ("cut", "expected the columns"),
        ("nowhere", "no report of `mluc bench`"),
    ] {
        let run = compare(other);
        assert_eq!(run.code, Some(1), "{other}");
        run.assert_says(&[words]);
    }
    let run = compare("good");
    assert_eq!(run.code, Some(0), "{}", run.log);
    assert_eq!(run.lines[0]["is_equal"], true, "{:?}", run.lines);
}
