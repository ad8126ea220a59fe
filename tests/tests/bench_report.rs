//! `mluc bench` writes a report whose figures are those of the frames in it.

use std::path::Path;
use std::time::Duration;

use mluc_tests::{Finished, Pipeline, clean_folder, untrained_model};
use serde_json::Value;

const PATIENCE: Duration = Duration::from_secs(180);

fn bench(folder: &Path, out: &Path, more: &[&str]) -> Finished {
    let (model, input) = (untrained_model(folder), clean_folder(folder, 3));
    let paths = [&model, &input, out].map(|path| path.display().to_string());
    let mut arguments = vec![
        "bench", "--model", &paths[0], "--input", &paths[1], "--out", &paths[2],
    ];
    arguments.extend(more);
    Pipeline::start(&arguments).finish_within(PATIENCE)
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).expect("a report")).expect("JSON")
}

/// The rows of frames.csv that were measured, by column.
fn measured(out: &Path) -> Vec<Vec<String>> {
    let text = std::fs::read_to_string(out.join("frames.csv")).expect("a table of frames");
    text.lines()
        .skip(1)
        .map(|line| line.split(',').map(str::to_string).collect::<Vec<_>>())
        .filter(|cells| cells[3] == "measured")
        .collect()
}

fn nearest_rank(values: &mut [f64], q: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((q * values.len() as f64 - 1e-9).ceil() as usize).max(1) - 1]
}

#[test]
fn the_report_holds_what_was_measured() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report");
    let run = bench(
        folder.path(),
        &out,
        &[
            "--seconds",
            "5",
            "--warm-up",
            "1",
            "--rate",
            "5",
            "--floor-rounds",
            "30",
        ],
    );
    assert!(matches!(run.code, Some(0 | 3)), "{}", run.log);
    let report = json(&out.join("report.json"));
    for key in ["p50", "p90", "p99", "p999", "max"] {
        assert!(
            report["end_to_end_us"][key].as_f64().unwrap() > 0.0,
            "{key}"
        );
        for stage in ["ingest", "backbone", "head", "refiner"] {
            for figure in ["queue_us", "run_us"] {
                assert!(
                    report["stages"][stage][figure][key].is_number(),
                    "{stage} {figure} {key}"
                );
            }
        }
    }
    for topic in ["points", "features"] {
        for key in [
            "p50_us",
            "p99_us",
            "raw_p50_us",
            "raw_p99_us",
            "socket_p50_us",
            "futex_p50_us",
            "memcpy_p50_us",
        ] {
            assert!(
                report["hops"][topic][key].as_f64().unwrap() > 0.0,
                "{topic} {key}: {}",
                report["hops"]
            );
        }
    }
    let rows = measured(&out);
    assert_eq!(report["frames"]["in"], rows.len());
    // 5 s at 5 Hz, the first second of 6 apart.
    assert_eq!(
        (rows.len(), &report["frames"]["warm_up"]),
        (25, &Value::from(5))
    );
    let out_count = rows.iter().filter(|cells| cells[4] == "out").count();
    assert_eq!(report["frames"]["out"], out_count);
    let mut latency_us: Vec<f64> = rows
        .iter()
        .map(|cells| cells[19].parse().unwrap())
        .collect();
    for (key, q) in [("p50", 0.5), ("p90", 0.9), ("max", 1.0)] {
        let expected = nearest_rank(&mut latency_us, q);
        let found = report["end_to_end_us"][key].as_f64().unwrap();
        assert!(
            (found - expected).abs() < 0.01,
            "{key}: {found} instead of {expected}"
        );
    }
    let text = |pointer: &str| {
        report
            .pointer(pointer)
            .and_then(Value::as_str)
            .unwrap_or_default()
            .to_string()
    };
    for pointer in [
        "/machine/kernel",
        "/machine/governor",
        "/build/commit",
        "/build/compiler",
        "/quiet/verdict",
        "/scenario/command",
    ] {
        assert!(!text(pointer).is_empty(), "{pointer}");
    }
    assert!(
        report["instrumentation"]["stamps_cost_us_a_hop"]
            .as_f64()
            .unwrap()
            < 1.0,
        "stamps cost below 1 us a hop"
    );
    assert!(
        report["stages"]["backbone"]["resources"]["cpu_cores"]
            .as_f64()
            .unwrap()
            > 0.0
    );
    assert!(report["first_frame"]["latency_us"].as_f64().unwrap() > 0.0);
}

#[test]
fn the_page_works_offline_and_the_terminal_shows_a_table() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report");
    let run = bench(
        folder.path(),
        &out,
        &[
            "--seconds",
            "3",
            "--warm-up",
            "0.5",
            "--rate",
            "5",
            "--floor-rounds",
            "0",
        ],
    );
    assert!(matches!(run.code, Some(0 | 3)), "{}", run.log);
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    for outside in ["http:", "https:", "<script", "<link", "<img", "url("] {
        assert!(!page.contains(outside), "{outside}");
    }
    assert_eq!(page.matches("<svg").count(), 5);
    assert!(
        page.contains("never trained"),
        "the warning stands on the page itself"
    );
    let terminal: String = run
        .lines
        .iter()
        .filter_map(Value::as_str)
        .collect::<Vec<_>>()
        .join("\n");
    for word in [
        "backbone",
        "end to end",
        "hand-over",
        "frames: 15 in",
        "report.html",
    ] {
        assert!(terminal.contains(word), "{word}: {terminal}");
    }
    assert!(!run.log.contains("####"), "a bar is for terminals alone");
}

#[test]
fn a_trace_shows_one_frame_over_all_processes() {
    let folder = tempfile::tempdir().unwrap();
    let (out, file) = (
        folder.path().join("report"),
        folder.path().join("trace.json"),
    );
    let trace = file.display().to_string();
    let run = bench(
        folder.path(),
        &out,
        &[
            "--seconds",
            "3",
            "--warm-up",
            "0.5",
            "--rate",
            "5",
            "--floor-rounds",
            "0",
            "--trace",
            &trace,
        ],
    );
    assert!(matches!(run.code, Some(0 | 3)), "{}", run.log);
    let trace = json(&file);
    let events = trace["traceEvents"].as_array().unwrap();
    let spans: Vec<&Value> = events.iter().filter(|event| event["ph"] == "X").collect();
    let sequence = &spans[0]["args"]["sequence"];
    assert!(
        spans
            .iter()
            .all(|span| span["args"]["sequence"] == *sequence),
        "one frame"
    );
    let processes: std::collections::BTreeSet<u64> = spans
        .iter()
        .filter_map(|span| span["pid"].as_u64())
        .collect();
    assert_eq!(processes.len(), 4, "{spans:?}");
    for name in ["frame", "run", "publish"] {
        assert!(
            spans.iter().filter(|span| span["name"] == name).count() >= 4,
            "{name}"
        );
    }
    let names: Vec<&Value> = events
        .iter()
        .filter(|event| event["name"] == "process_name")
        .collect();
    assert_eq!(names.len(), 4);
    assert_eq!(
        events.iter().filter(|event| event["ph"] == "s").count(),
        3,
        "an arrow a hand-over"
    );
    // The spans agree with the stamps of the same frame.
    let row = measured(&out)
        .into_iter()
        .find(|cells| cells[1].parse().ok() == sequence.as_u64())
        .expect("the frame is in the table");
    let stamped_us: f64 = row[11].parse::<f64>().unwrap() - row[10].parse::<f64>().unwrap();
    let backbone = names
        .iter()
        .find(|event| event["args"]["name"] == "backbone")
        .expect("its name");
    let whole = spans
        .iter()
        .find(|span| span["name"] == "frame" && span["pid"] == backbone["pid"])
        .expect("its span");
    assert!(
        whole["dur"].as_f64().unwrap() >= stamped_us * 0.9,
        "{whole} against {stamped_us} us by the stamps"
    );
    assert!(
        !out.join("spans").exists(),
        "what was only needed for the trace is gone"
    );
}
