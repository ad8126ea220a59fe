//! Two refiners, and two builds, on the same frames, interleaved.

use mluc_tests::{Running, Setting, assert_has, mluc_program, read_json};
use serde_json::{Value, json};
use std::path::Path;

/// Options of a short run, with the two sides interleaved.
const SHORT: &str = "--seconds 4 --warm-up 0.5 --rate 8 --rounds 2";

/// The reports of both sides.
fn reports(out: &Path) -> [Value; 2] {
    ["a", "b"].map(|side| read_json(&out.join(side).join("report.json")))
}

#[test]
fn two_refiners_are_measured_on_the_same_frames() {
    let setting = Setting::new("bench", 2);
    let out = setting.report();
    let run = setting.bench(&format!("{SHORT} --refiner none --refiner range-scaled"));
    let comparison = read_json(&out.join("comparison.json"));
    assert_eq!(comparison["names"], json!(["none", "range-scaled"]));
    let twice = format!("bench compare --json {0}/a {0}/a", out.display());
    let compared = Running::mluc(twice.split(' ')).finish();
    assert_eq!(compared.code, Some(0), "{}", compared.log);
    assert_eq!(compared.lines[0]["is_equal"], true);
    let [a, b] = reports(&out);
    assert_eq!(a["scenario"]["refiner"], "none");
    assert_eq!(b["scenario"]["refiner"], "range-scaled");
    assert_eq!(a["frames"]["in"], b["frames"]["in"]);
    // The report has the noise of the noisiest round, and the other figures of the last round.
    let others = |report: &Value| report["quiet"]["other_processes_share_of_all_cores"].as_f64();
    let rounds = [0, 1].map(|n| out.join(format!("a/round-{n}/report.json")));
    let shares = rounds.iter().filter_map(|path| others(&read_json(path)));
    assert_eq!(others(&a), shares.reduce(f64::max));
    assert!(a["stages"]["backbone"]["resources"]["cpu_cores"].as_f64() > Some(0.0));
    assert!(a["hops"]["points"]["payload_bytes"].as_f64() > Some(0.0));
    assert_has(&run.text(), &["refiner run p50", "end to end p50"]);
}

#[test]
fn two_builds_are_measured_by_their_own_programs() {
    let setting = Setting::new("bench", 2);
    let out = setting.report();
    let program = mluc_program().display().to_string();
    setting.bench(&format!("{SHORT} --against {program}"));
    let comparison = read_json(&out.join("comparison.json"));
    assert_eq!(comparison["names"][1], program);
    for (side, report) in ["a", "b"].into_iter().zip(reports(&out)) {
        // 4 s at 8 Hz, over two starts.
        assert_eq!(report["frames"]["in"], 32, "{side}");
        assert!(!report["build"]["binary"].as_str().unwrap().is_empty());
    }
}
