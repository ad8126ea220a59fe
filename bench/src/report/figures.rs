//! The report as a file for programs: `report.json`.

use anyhow::ensure;
use mluc_geometry::quantile;
use serde::{Serialize, Serializer};
use serde_json::{Map, Value};

use super::frame::{FrameRecord, HOPS, STAGES, measured};
use super::series::{series, sorted};

/// Version of `report.json` and `frames.csv`; another one is refused.
pub(crate) const REPORT_VERSION: u32 = 1;

fn by_stage<T: Serialize, S: Serializer>(values: &[T; 4], to: S) -> Result<S::Ok, S::Error> {
    to.collect_map(STAGES.iter().zip(values))
}

fn by_hop<T: Serialize, S: Serializer>(values: &[T; 4], to: S) -> Result<S::Ok, S::Error> {
    to.collect_map(HOPS.iter().zip(values))
}

/// Quantiles and the largest value; every value is kept, so that no histogram rounds the tail.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub(crate) struct Percentiles {
    pub(crate) p50: f64,
    pub(crate) p90: f64,
    pub(crate) p99: f64,
    /// 999 of 1000 are at most this; with fewer than 1000 values: the largest.
    pub(crate) p999: f64,
    pub(crate) max: f64,
}

impl Percentiles {
    /// Of any number of values in any order; `None` without values.
    pub(crate) fn of(values: &[f64]) -> Option<Percentiles> {
        let ascending = sorted(values);
        // Thousandths are beyond any clock here.
        let at = |q: f64| Some((quantile(&ascending, q)? * 1000.0).round() / 1000.0);
        Some(Percentiles {
            p50: at(0.50)?,
            p90: at(0.90)?,
            p99: at(0.99)?,
            p999: at(0.999)?,
            max: at(1.0)?,
        })
    }
}

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct Resources {
    pub(crate) threads: u32,
    /// CPU time over time: 1 is a whole core.
    pub(crate) cpu_cores: f64,
    pub(crate) memory_mib: f64,
    /// Largest shared memory mapped and touched; several stages touch the same pages.
    pub(crate) shared_memory_mib: f64,
    /// The process gave the CPU up, by second.
    pub(crate) switches_voluntary_per_s: f64,
    /// The kernel took the CPU away, by second.
    pub(crate) switches_forced_per_s: f64,
    /// Ready to run but without a CPU, threads together: share of the time.
    pub(crate) waiting_for_cpu: f64,
}

/// A stage's figures: see the terms of [`crate::report`].
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct StageFigures {
    pub(crate) queue_us: Percentiles,
    pub(crate) run_us: Percentiles,
    pub(crate) resources: Resources,
}

/// A topic's hand-over, and what the machine gives at best. `None`: not measured.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct HandOver {
    pub(crate) payload_bytes: u64,
    /// Frames whose consumer was idle.
    pub(crate) frames: usize,
    /// From publication to the consumer having it.
    pub(crate) p50_us: Option<f64>,
    pub(crate) p99_us: Option<f64>,
    #[serde(flatten)]
    pub(crate) baselines: Baselines,
}

/// What a message of the same size costs between two idle processes, measured in turn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub(crate) struct Baselines {
    /// Our hop: what the transport costs without a pipeline around it.
    pub(crate) alone_p50_us: Option<f64>,
    pub(crate) alone_p99_us: Option<f64>,
    /// Raw iceoryx2 with the same payload and wake-up.
    pub(crate) raw_p50_us: Option<f64>,
    pub(crate) raw_p99_us: Option<f64>,
    /// A Unix socket copying the same bytes.
    pub(crate) socket_p50_us: Option<f64>,
    /// Waking another process, nothing else.
    pub(crate) futex_p50_us: Option<f64>,
    /// A copy of the payload inside of one process.
    pub(crate) memcpy_p50_us: Option<f64>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct AllHandOvers {
    pub(crate) p50_us: Option<f64>,
    pub(crate) p99_us: Option<f64>,
    /// The median's share of a frame of 100 ms.
    pub(crate) share_of_100_ms: Option<f64>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct FrameCounts {
    #[serde(rename = "in")]
    pub(crate) taken_in: usize,
    pub(crate) out: usize,
    /// Overtaken by a newer one; they count in `end_to_end_us`.
    pub(crate) dropped: usize,
    /// Nothing newer came either: counted with a lower bound.
    pub(crate) unanswered: usize,
    pub(crate) warm_up: usize,
}

/// The first frame after the start, worst of all rounds.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct FirstFrame {
    /// End to end; `None`: it was dropped.
    pub(crate) latency_us: Option<f64>,
    /// Over the median of the measured frames.
    pub(crate) over_steady: Option<f64>,
    /// Computing, by stage, over the stage's median.
    #[serde(serialize_with = "by_stage")]
    pub(crate) run_over_steady: [Option<f64>; 4],
}

/// All figures. `report.json` is this.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct LatencyReport {
    pub(crate) report_version: u32,
    pub(crate) title: String,
    /// What a reader must know before believing a figure.
    pub(crate) warnings: Vec<String>,
    /// From due to objects, every frame.
    pub(crate) end_to_end_us: Percentiles,
    /// The same of the frames that came out.
    pub(crate) end_to_end_delivered_us: Percentiles,
    #[serde(serialize_with = "by_stage")]
    pub(crate) stages: [StageFigures; 4],
    #[serde(serialize_with = "by_hop")]
    pub(crate) hops: [HandOver; 4],
    pub(crate) hops_together: AllHandOvers,
    pub(crate) frames: FrameCounts,
    pub(crate) first_frame: FirstFrame,
    pub(crate) quiet: Map<String, Value>,
    pub(crate) machine: Map<String, Value>,
    pub(crate) build: Map<String, Value>,
    pub(crate) scenario: Map<String, Value>,
    pub(crate) instrumentation: Map<String, Value>,
}

impl LatencyReport {
    /// The figures that follow from the frames; the rest is the caller's.
    pub(crate) fn of_frames(frames: &[FrameRecord]) -> LatencyReport {
        let measured = measured(frames);
        let figures = series(&measured);
        let of = |values: &[f64]| Percentiles::of(values).unwrap_or_default();
        let end_to_end_us = of(&figures.latency_us);
        let stages = std::array::from_fn(|stage| StageFigures {
            queue_us: of(&figures.queue_us[stage]),
            run_us: of(&figures.run_us[stage]),
            resources: Resources::default(),
        });
        let hop = |values: &Vec<f64>| {
            let percentiles = Percentiles::of(values);
            HandOver {
                frames: values.len(),
                p50_us: percentiles.map(|p| p.p50),
                p99_us: percentiles.map(|p| p.p99),
                ..HandOver::default()
            }
        };
        let together = Percentiles::of(&figures.hops_together_us);
        let out = figures.delivered_us.len();
        LatencyReport {
            report_version: REPORT_VERSION,
            end_to_end_us,
            end_to_end_delivered_us: of(&figures.delivered_us),
            first_frame: first_frame(frames, &end_to_end_us, &stages),
            stages,
            hops: figures.hand_over_us.each_ref().map(hop),
            hops_together: AllHandOvers {
                p50_us: together.map(|p| p.p50),
                p99_us: together.map(|p| p.p99),
                share_of_100_ms: together.map(|p| p.p50 / 100_000.0),
            },
            frames: FrameCounts {
                taken_in: measured.len(),
                out,
                dropped: measured.len() - out,
                unanswered: figures.unanswered,
                warm_up: frames.len() - measured.len(),
            },
            ..LatencyReport::default()
        }
    }

    /// The period between frames by the scenario, ms.
    pub(crate) fn period_ms(&self) -> Option<f64> {
        let rate_hz = self.scenario.get("rate_hz")?.as_f64()?;
        (rate_hz > 0.0).then(|| 1000.0 / rate_hz)
    }
}

fn first_frame(
    frames: &[FrameRecord],
    steady: &Percentiles,
    stages: &[StageFigures; 4],
) -> FirstFrame {
    let worst = |of: &dyn Fn(&FrameRecord) -> Option<f64>| -> Option<f64> {
        let firsts = frames.iter().filter(|frame| frame.sequence == 0);
        firsts.filter_map(of).max_by(f64::total_cmp)
    };
    let over = |value: Option<f64>, steady: f64| value.filter(|_| steady > 0.0).map(|v| v / steady);
    let latency_us = worst(&FrameRecord::delivered_us);
    FirstFrame {
        latency_us,
        over_steady: over(latency_us, steady.p50),
        run_over_steady: std::array::from_fn(|stage| {
            let first_us = worst(&|frame| frame.run_us(stage));
            over(first_us, stages[stage].run_us.p50)
        }),
    }
}

/// Refuses a `report.json` of another version before anything else of it is believed.
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
        let report = serde_json::to_value(LatencyReport::of_frames(&frames)).unwrap();
        assert_eq!(
            report["frames"],
            serde_json::json!({"in": 39, "out": 38, "dropped": 1, "unanswered": 0, "warm_up": 1})
        );
        assert_eq!(report["end_to_end_us"]["max"], 104_040.0);
        assert_eq!(report["end_to_end_delivered_us"]["max"], 4040.0);
        assert_eq!(report["first_frame"]["latency_us"], 12_040.0);
        assert_eq!(report["first_frame"]["run_over_steady"]["head"], 3.0);
        assert_eq!(report["hops_together"]["p50_us"], 50.0);
    }
}
