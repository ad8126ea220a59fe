//! The report on a terminal.

use mluc_report::{HOPS, Report, STAGES};

/// Everything that fits on a screen.
pub(super) fn table(report: &Report) -> String {
    let mut text = format!("{}\n", report.title);
    let fact = |map: &serde_json::Map<String, serde_json::Value>, key: &str| {
        map.get(key)
            .and_then(|value| value.as_str())
            .unwrap_or("?")
            .to_string()
    };
    text += &format!(
        "{}, kernel {}; commit {}\n\n",
        fact(&report.machine, "processor"),
        fact(&report.machine, "kernel"),
        fact(&report.build, "commit")
    );
    text += &format!(
        "{:22}{:>9}{:>9}{:>9}{:>9}{:>9}   {:>6}{:>9}\n",
        "ms", "p50", "p90", "p99", "p99.9", "max", "cores", "MiB"
    );
    let mut row = |name: &str, p: &mluc_report::Percentiles, more: String| {
        let numbers: String = [p.p50, p.p90, p.p99, p.p999, p.max]
            .iter()
            .map(|us| format!("{:9.2}", us / 1000.0))
            .collect();
        text += &format!("{name:22}{numbers}{more}\n");
    };
    for (name, stage) in STAGES.iter().zip(report.stages.each()) {
        let took = &stage.resources;
        row(
            name,
            &stage.run_us,
            format!("   {:6.2}{:9.0}", took.cpu_cores, took.memory_mib),
        );
        row("  queue before", &stage.queue_us, String::new());
    }
    row("end to end", &report.end_to_end_us, String::new());
    text += &format!(
        "\n{:22}{:>9}{:>9}{:>9}{:>9}{:>9}{:>9}{:>9}{:>9}\n",
        "hand-over, us", "p50", "p99", "alone", "raw", "futex", "socket", "memcpy", "bytes"
    );
    for (name, hop) in HOPS.iter().zip(report.hops.each()) {
        let us = |value: Option<f64>| value.map_or(format!("{:>9}", "-"), |us| format!("{us:9.1}"));
        let numbers: String = [
            hop.p50_us,
            hop.p99_us,
            hop.alone_p50_us,
            hop.raw_p50_us,
            hop.futex_p50_us,
            hop.socket_p50_us,
            hop.memcpy_p50_us,
        ]
        .map(us)
        .concat();
        text += &format!("{name:22}{numbers}{:9}\n", hop.payload_bytes);
    }
    let counts = &report.frames;
    text += &format!(
        "\nframes: {} in, {} out, {} dropped; {} of the warm-up apart\n",
        counts.taken_in, counts.out, counts.dropped, counts.warm_up
    );
    if let (Some(us), Some(ratio)) = (
        report.first_frame.latency_us,
        report.first_frame.over_steady,
    ) {
        text += &format!(
            "first frame: {:.1} ms, {ratio:.2} times the median\n",
            us / 1000.0
        );
    }
    text += &format!("machine: {}\n", fact(&report.quiet, "verdict"));
    for warning in &report.warnings {
        text += &format!("warning: {warning}\n");
    }
    text
}
