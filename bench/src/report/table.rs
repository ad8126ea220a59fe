//! The report on a terminal.

use serde_json::Value;

use super::figures::number;
use super::frame::{HOPS, STAGES};

/// Everything that fits on a screen.
pub(crate) fn table(report: &Value) -> String {
    let fact = |pointer: &str| {
        report
            .pointer(pointer)
            .and_then(Value::as_str)
            .unwrap_or("?")
    };
    let [title, processor, kernel] = ["/title", "/machine/processor", "/machine/kernel"].map(fact);
    let commit = fact("/build/commit");
    let mut text = format!(
        "{title}\n{processor}, kernel {kernel}; commit {commit}\n\n{:22}",
        "ms"
    );
    text += "      p50      p90      p99    p99.9      max    cores      MiB\n";
    let mut row = |name: &str, us: &Value, more: String| {
        let ms = ["p50", "p90", "p99", "p999", "max"];
        let ms = ms.map(|q| format!("{:9.2}", us[q].as_f64().unwrap_or(0.0) / 1000.0));
        text += &format!("{name:22}{}{more}\n", ms.concat());
    };
    for name in STAGES {
        let stage = &report["stages"][name];
        let took = |key: &str| stage["resources"][key].as_f64().unwrap_or(0.0);
        let (cores, mib) = (took("cpu_cores"), took("memory_mib"));
        row(name, &stage["run_us"], format!("   {cores:6.2}{mib:9.0}"));
        row("  queue before", &stage["queue_us"], String::new());
    }
    row("end to end", &report["end_to_end_us"], String::new());
    text += &hand_overs(&report["hops"]);
    let [taken_in, out, dropped, warm_up] =
        ["in", "out", "dropped", "warm_up"].map(|key| &report["frames"][key]);
    text += &format!(
        "\nframes: {taken_in} in, {out} out, {dropped} dropped; {warm_up} of the warm-up apart\n"
    );
    let first = |key: &str| report["first_frame"][key].as_f64();
    if let (Some(us), Some(ratio)) = (first("latency_us"), first("over_steady")) {
        let ms = us / 1000.0;
        text += &format!("first frame: {ms:.1} ms, {ratio:.2} times the median\n");
    }
    text += &format!("machine: {}\n", fact("/quiet/verdict"));
    for warning in report["warnings"].as_array().into_iter().flatten() {
        text += &format!("warning: {}\n", warning.as_str().unwrap_or_default());
    }
    text
}

fn hand_overs(hops: &Value) -> String {
    let heads = "p50 p99 alone raw futex socket memcpy bytes".split(' ');
    let heads: String = heads.map(|head| format!("{head:>9}")).collect();
    let mut text = format!("\n{:22}{heads}\n", "hand-over, us");
    let keys = "p50 p99 alone_p50 raw_p50 futex_p50 socket_p50 memcpy_p50";
    for name in HOPS {
        let us = |key: &str| match number(&hops[name], &format!("/{key}_us")) {
            Some(us) => format!("{us:9.1}"),
            None => format!("{:>9}", "-"),
        };
        let numbers: String = keys.split(' ').map(us).collect();
        let bytes = number(&hops[name], "/payload_bytes").unwrap_or(0.0);
        text += &format!("{name:22}{numbers}{bytes:9}\n");
    }
    text
}
