//! `mluc bench` writes a report whose figures are those of the frames in it.

use mluc_tests::{Finished, Setting, assert_has, read_json, root, skip};
use serde_json::Value;
use std::{path::Path, process::Command};

/// The measured rows of frames.csv, as columns.
fn measured(out: &Path) -> Vec<Vec<String>> {
    let text = std::fs::read_to_string(out.join("frames.csv")).expect("a table of frames");
    let rows = text.lines().skip(1);
    let rows = rows.map(|line| line.split(',').map(str::to_string).collect::<Vec<_>>());
    rows.filter(|cells| cells[3] == "measured").collect()
}

#[test]
fn the_report_holds_what_was_measured() {
    let setting = Setting::new("bench", 3);
    let out = setting.report();
    let run = setting.bench("--seconds 5 --warm-up 1 --rate 5");
    let report = read_json(&out.join("report.json"));
    every_stage_and_hop_has_its_figures(&report);
    let rows = measured(&out);
    assert_eq!(report["frames"]["in"], rows.len());
    // 5 s at 5 Hz: the first of 6 seconds is warm-up.
    assert_eq!((rows.len(), &report["frames"]["warm_up"]), (25, &5.into()));
    let out_count = rows.iter().filter(|cells| cells[4] == "out").count();
    assert_eq!(report["frames"]["out"], out_count);
    let latency_us: Vec<f64> = rows.iter().map(|cells| cells[19].parse().unwrap()).collect();
    for (key, q) in [("p50", 0.5), ("p90", 0.9), ("max", 1.0)] {
        let expected = mluc_geometry::quantile_of(latency_us.clone(), q).expect("frames");
        let found = number(&report, &format!("/end_to_end_us/{key}"));
        let off_us = (found - expected).abs();
        assert!(off_us < 0.01, "{key}: {found} instead of {expected}");
    }
    the_circumstances_are_told(&report);
    the_page_works_offline(&std::fs::read_to_string(out.join("report.html")).unwrap());
    the_terminal_shows_a_table(&run);
    a_trace_shows_the_frames_over_all_processes(&out, &rows);
}

/// A number of a report by its JSON pointer.
fn number(report: &Value, pointer: &str) -> f64 {
    report.pointer(pointer).and_then(Value::as_f64).unwrap_or_else(|| panic!("{pointer}: {report}"))
}

fn every_stage_and_hop_has_its_figures(report: &Value) {
    for key in ["p50", "p90", "p99", "p999", "max"] {
        assert!(number(report, &format!("/end_to_end_us/{key}")) > 0.0);
        for stage in ["ingest", "backbone", "head", "refiner"] {
            for figure in ["queue_us", "run_us"] {
                number(report, &format!("/stages/{stage}/{figure}/{key}"));
            }
        }
    }
    for topic in ["points", "features"] {
        for key in ["p50_us", "p99_us", "payload_bytes"] {
            let pointer = format!("/hops/{topic}/{key}");
            assert!(number(report, &pointer) > 0.0, "{pointer}");
        }
    }
}

fn the_circumstances_are_told(report: &Value) {
    let texts = "/machine/kernel /machine/governor /build/commit /build/compiler /quiet/verdict";
    for pointer in texts.split(' ').chain(["/scenario/command"]) {
        let text = report.pointer(pointer).and_then(Value::as_str);
        assert!(text.is_some_and(|text| !text.is_empty()), "{pointer}");
    }
    let cores = "/stages/backbone/resources/cpu_cores";
    for pointer in [cores, "/first_frame/latency_us"] {
        assert!(number(report, pointer) > 0.0, "{pointer}");
    }
}

fn the_page_works_offline(page: &str) {
    for outside in ["http:", "https:", "<script", "<link", "<img", "url("] {
        assert!(!page.contains(outside), "{outside}");
    }
    assert_eq!(page.matches("<svg").count(), 3);
    assert!(page.contains("never trained"), "the warning stands on the page itself");
}

fn the_terminal_shows_a_table(run: &Finished) {
    let terminal = run.text();
    let words = "backbone|end to end|hand-over|frames: 25 in|report.html";
    assert_has(&terminal, &words.split('|').collect::<Vec<_>>());
    assert!(!run.log.contains("####"), "a bar is for terminals alone");
}

/// `tools/trace` on the same frames.
fn a_trace_shows_the_frames_over_all_processes(out: &Path, rows: &[Vec<String>]) {
    let mut trace = Command::new(root().join("tools/trace"));
    let output = trace.arg(out).output().expect("a script");
    if output.status.code() == Some(127) {
        return skip("tools/trace", "no python3");
    }
    let trace: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let events = trace["traceEvents"].as_array().unwrap();
    let having = |key: &str, value: &str| -> Vec<&Value> {
        events.iter().filter(|event| event[key] == value).collect()
    };
    let (spans, names) = (having("ph", "X"), having("name", "process_name"));
    let frames = spans.len() / 8;
    assert!(frames > 5, "wait and run of each stage");
    assert_eq!(spans.len(), 8 * frames);
    assert_eq!((names.len(), having("ph", "s").len()), (4, 3 * frames));
    // The span of the last frame, because the first frames are warm-up.
    let is_run = |span: &&&Value| span["name"] == "run" && span["pid"] == 1;
    let run = spans.iter().rev().find(is_run).expect("the backbone's");
    let sequence = run["args"]["sequence"].as_u64();
    let row = rows.iter().find(|cells| cells[1].parse().ok() == sequence);
    let row = row.expect("the frame is in the table");
    let [started_us, published_us] = [10, 11].map(|column| row[column].parse::<f64>().unwrap());
    let off_us = run["dur"].as_f64().unwrap() - (published_us - started_us);
    assert!(off_us.abs() < 1.0, "{run} against {row:?}");
}
