//! The report on a terminal.

use super::figures::{LatencyReport, Percentiles};
use super::frame::{HOPS, STAGES};

impl LatencyReport {
    pub(crate) fn table(&self) -> String {
        let fact = |map: &serde_json::Map<String, serde_json::Value>, key: &str| {
            let value = map.get(key).and_then(|value| value.as_str());
            value.unwrap_or("?").to_string()
        };
        let mut text = format!(
            "{}\n{}, kernel {}; commit {}\n\n{:22}{:>9}{:>9}{:>9}{:>9}{:>9}   {:>6}{:>9}\n",
            self.title,
            fact(&self.machine, "processor"),
            fact(&self.machine, "kernel"),
            fact(&self.build, "commit"),
            "ms",
            "p50",
            "p90",
            "p99",
            "p99.9",
            "max",
            "cores",
            "MiB"
        );
        let mut row = |name: &str, p: &Percentiles, more: String| {
            let ms = [p.p50, p.p90, p.p99, p.p999, p.max].map(|us| format!("{:9.2}", us / 1000.0));
            text += &format!("{name:22}{}{more}\n", ms.concat());
        };
        for (name, stage) in STAGES.iter().zip(&self.stages) {
            let (cores, mib) = (stage.resources.cpu_cores, stage.resources.memory_mib);
            row(name, &stage.run_us, format!("   {cores:6.2}{mib:9.0}"));
            row("  queue before", &stage.queue_us, String::new());
        }
        row("end to end", &self.end_to_end_us, String::new());
        text += &self.hand_overs();
        let counts = &self.frames;
        text += &format!(
            "\nframes: {} in, {} out, {} dropped; {} of the warm-up apart\n",
            counts.taken_in, counts.out, counts.dropped, counts.warm_up
        );
        let first = &self.first_frame;
        if let (Some(us), Some(ratio)) = (first.latency_us, first.over_steady) {
            let ms = us / 1000.0;
            text += &format!("first frame: {ms:.1} ms, {ratio:.2} times the median\n");
        }
        text += &format!("machine: {}\n", fact(&self.quiet, "verdict"));
        for warning in &self.warnings {
            text += &format!("warning: {warning}\n");
        }
        text
    }

    fn hand_overs(&self) -> String {
        let heads = "p50 p99 alone raw futex socket memcpy bytes".split(' ');
        let heads: String = heads.map(|head| format!("{head:>9}")).collect();
        let mut text = format!("\n{:22}{heads}\n", "hand-over, us");
        for (name, hop) in HOPS.iter().zip(&self.hops) {
            let b = &hop.baselines;
            let own = [hop.p50_us, hop.p99_us, b.alone_p50_us, b.raw_p50_us];
            let others = [b.futex_p50_us, b.socket_p50_us, b.memcpy_p50_us];
            let us = |us: &f64| format!("{us:9.1}");
            let us = |value: &Option<f64>| value.as_ref().map_or(format!("{:>9}", "-"), us);
            let numbers: String = own.iter().chain(&others).map(us).collect();
            text += &format!("{name:22}{numbers}{:9}\n", hop.payload_bytes);
        }
        text
    }
}
