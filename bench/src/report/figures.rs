//! The report as a file for programs, `report.json`; docs/bench.md lists its keys. `null`: not measured.

use super::frame::{FrameRecord, HOPS, STAGES, measured};
use super::series::series;
use anyhow::ensure;
use mluc_geometry::quantile_of;
use serde::Serialize;
use serde_json::{Value, json};

/// Version of `report.json` and `frames.csv`; another one is refused.
const REPORT_VERSION: u32 = 1;

/// Resources that a stage's process used.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct Resources {
    pub(crate) threads: u32,
    /// CPU time per elapsed time: 1 is a whole core.
    pub(crate) cpu_cores: f64,
    /// Largest private memory.
    pub(crate) memory_mib: f64,
    /// Largest shared memory mapped and touched; several stages touch the same pages.
    pub(crate) shared_memory_mib: f64,
    /// How often the kernel took the CPU away, per second.
    pub(crate) switches_forced_per_s: f64,
    /// Time that threads were ready to run but had no CPU, summed over threads: share of the time.
    pub(crate) waiting_for_cpu: f64,
}

/// The figures computed from the frames. The caller adds machine, resources and message sizes.
pub(crate) fn report_of(frames: &[FrameRecord]) -> Value {
    let measured = measured(frames);
    let figures = series(&measured);
    let end_to_end_us = percentiles(&figures.latency_us);
    let stages = by_name(STAGES, |stage| {
        let (queue_us, run_us) = (&figures.queue_us[stage], &figures.run_us[stage]);
        json!({"queue_us": percentiles(queue_us), "run_us": percentiles(run_us), "resources": Resources::default()})
    });
    let hops = by_name(HOPS, |hop| {
        let us = &figures.hand_over_us[hop];
        json!({"frames": us.len(), "p50_us": at(us, 0.5), "p99_us": at(us, 0.99)})
    });
    let together_us = &figures.hops_together_us;
    let out = figures.delivered_us.len();
    json!({
        "report_version": REPORT_VERSION,
        "first_frame": first_frame(frames, &end_to_end_us, &stages),
        "end_to_end_us": end_to_end_us,
        "end_to_end_delivered_us": percentiles(&figures.delivered_us),
        "stages": stages,
        "hops": hops,
        "hops_together": {
            "p50_us": at(together_us, 0.5),
            "p99_us": at(together_us, 0.99),
            "share_of_100_ms": at(together_us, 0.5).map(|us| us / 100_000.0),
        },
        "frames": {
            "in": measured.len(),
            "out": out,
            "dropped": measured.len() - out,
            "unanswered": figures.unanswered,
            "warm_up": frames.len() - measured.len(),
        },
    })
}

/// The first frame after a start: the worst of all rounds, and its ratio to the median.
fn first_frame(frames: &[FrameRecord], end_to_end_us: &Value, stages: &Value) -> Value {
    let worst = |of: &dyn Fn(&FrameRecord) -> Option<f64>| -> Option<f64> {
        frames.iter().filter(|frame| frame.sequence == 0).filter_map(of).max_by(f64::total_cmp)
    };
    let over = |first_us: Option<f64>, steady_us: &Value| {
        let steady_us = number(steady_us, "/p50").filter(|us| *us > 0.0)?;
        Some(first_us? / steady_us)
    };
    let latency_us = worst(&FrameRecord::delivered_us);
    let run_over_steady = by_name(STAGES, |stage| {
        let first_us = worst(&|frame| frame.run_us(stage));
        json!(over(first_us, &stages[STAGES[stage]]["run_us"]))
    });
    json!({
        "latency_us": latency_us,
        "over_steady": over(latency_us, end_to_end_us),
        "run_over_steady": run_over_steady,
    })
}

/// Quantile by nearest rank over all values, so that no histogram rounds the tail; `None` without values.
fn at(values: &[f64], q: f64) -> Option<f64> {
    // No clock here resolves more than thousandths.
    Some((quantile_of(values.to_vec(), q)? * 1000.0).round() / 1000.0)
}

/// Percentiles of any number of values; zeros without values.
fn percentiles(values: &[f64]) -> Value {
    let named = ["p50", "p90", "p99", "p999", "max"].into_iter().zip([0.5, 0.9, 0.99, 0.999, 1.0]);
    let value = |q: f64| at(values, q).unwrap_or(0.0);
    named.map(|(name, q)| (name, value(q))).collect()
}

/// Four values as an object.
fn by_name(names: [&str; 4], value: impl Fn(usize) -> Value) -> Value {
    names.into_iter().enumerate().map(|(index, name)| (name, value(index))).collect()
}

/// A number of a report by its JSON pointer.
pub(crate) fn number(report: &Value, pointer: &str) -> Option<f64> {
    report.pointer(pointer)?.as_f64()
}

/// A number with its significant digits.
pub(super) fn short(value: f64) -> String {
    let digits = match value.abs() {
        v if v >= 99.95 => 0,
        v if v >= 9.995 => 1,
        v if v >= 0.995 => 2,
        0.0 => 0,
        _ => 3,
    };
    let text = format!("{value:.digits$}");
    if digits == 0 {
        return text;
    }
    text.trim_end_matches('0').trim_end_matches('.').to_string()
}

/// Refuses a `report.json` of another version. Call it before using any other value.
pub(crate) fn check_version(report: &Value) -> anyhow::Result<()> {
    let found = &report["report_version"];
    ensure!(
        found.as_u64() == Some(u64::from(REPORT_VERSION)),
        "report version {found}, expected {REPORT_VERSION}: it was written by another mluc; run `mluc bench` again with this one"
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::frame::testing::{dropped, frame};

    #[test]
    fn dropped_frames_and_the_first_one_count_as_documented() {
        let mut frames: Vec<FrameRecord> = (0..40).map(|n| frame(n, 1000)).collect();
        frames[30] = dropped(30);
        frames[0] = frame(0, 3000);
        frames[0].is_warm_up = true;
        let report = report_of(&frames);
        let counts = json!({"in": 39, "out": 38, "dropped": 1, "unanswered": 0, "warm_up": 1});
        assert_eq!(report["frames"], counts);
        assert_eq!(report["end_to_end_us"]["max"], 104_040.0);
        assert_eq!(report["end_to_end_delivered_us"]["max"], 4040.0);
        assert_eq!(report["first_frame"]["latency_us"], 12_040.0);
        assert_eq!(report["first_frame"]["run_over_steady"]["head"], 3.0);
        assert_eq!(report["hops_together"]["p50_us"], 50.0);
    }

    #[test]
    fn numbers_are_short() {
        let texts = [0.0, 0.0123, 1.5, 2.0, 12.34, 99.97, 1234.5].map(short);
        assert_eq!(texts, ["0", "0.012", "1.5", "2", "12.3", "100", "1234"]);
    }
}
