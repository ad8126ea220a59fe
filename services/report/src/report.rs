//! The report as a file for programs: `report.json`.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::ReportError;
use crate::frame::{Frame, HOPS};
use crate::series::{Series, series};
use crate::statistics::Percentiles;

/// Version of `report.json` and `frames.csv`; another one is refused.
pub const REPORT_VERSION: u32 = 1;

/// One value a stage.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ByStage<T> {
    /// Brings scans in.
    pub ingest: T,
    /// Points to feature rows.
    pub backbone: T,
    /// Feature rows to detections.
    pub head: T,
    /// Detections to objects.
    pub refiner: T,
}

impl<T> ByStage<T> {
    /// By a function of the stage's number.
    pub fn new(mut of: impl FnMut(usize) -> T) -> ByStage<T> {
        ByStage {
            ingest: of(0),
            backbone: of(1),
            head: of(2),
            refiner: of(3),
        }
    }

    /// In order.
    pub fn each(&self) -> [&T; 4] {
        [&self.ingest, &self.backbone, &self.head, &self.refiner]
    }
}

/// What a stage's process took of the machine.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Resources {
    /// Threads.
    pub threads: u32,
    /// CPU time over time: 1 is a whole core.
    pub cpu_cores: f64,
    /// Largest private memory, MiB.
    pub memory_mib: f64,
    /// Largest shared memory mapped and touched, MiB; several stages touch the same pages.
    pub shared_memory_mib: f64,
    /// The process gave the CPU up, by second.
    pub switches_voluntary_per_s: f64,
    /// The kernel took the CPU away, by second.
    pub switches_forced_per_s: f64,
    /// Ready to run but without a CPU, threads together: share of the time.
    pub waiting_for_cpu: f64,
}

/// A stage's figures.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StageReport {
    /// From its input's publication to the start of computing.
    pub queue_us: Percentiles,
    /// From there to the publication of its result.
    pub run_us: Percentiles,
    /// Of its process.
    pub resources: Resources,
}

/// A topic's hand-over, and what the machine gives at best. `None`: not measured.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Hop {
    /// Payload of a usual message.
    pub payload_bytes: u64,
    /// Frames whose consumer was idle.
    pub frames: usize,
    /// From publication to the consumer having it.
    pub p50_us: Option<f64>,
    /// The same.
    pub p99_us: Option<f64>,
    /// Our hop between two idle processes, in turn with raw iceoryx2: what the transport costs without a pipeline around it.
    pub alone_p50_us: Option<f64>,
    /// The same.
    pub alone_p99_us: Option<f64>,
    /// Raw iceoryx2 with the same payload and wake-up.
    pub raw_p50_us: Option<f64>,
    /// The same.
    pub raw_p99_us: Option<f64>,
    /// A Unix socket copying the same bytes.
    pub socket_p50_us: Option<f64>,
    /// Waking another process, nothing else.
    pub futex_p50_us: Option<f64>,
    /// A copy of the payload inside of one process.
    pub memcpy_p50_us: Option<f64>,
}

/// One value a topic.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ByHop<T> {
    /// Ingest to backbone.
    pub points: T,
    /// Backbone to head.
    pub features: T,
    /// Head to refiner.
    pub detections: T,
    /// Refiner to whoever takes the objects.
    pub objects: T,
}

impl<T> ByHop<T> {
    /// In order.
    pub fn each(&self) -> [&T; HOPS.len()] {
        [
            &self.points,
            &self.features,
            &self.detections,
            &self.objects,
        ]
    }
}

/// All hand-overs of a frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct HopsTogether {
    /// Median.
    pub p50_us: Option<f64>,
    /// 99th percentile.
    pub p99_us: Option<f64>,
    /// The median's share of a frame of 100 ms.
    pub share_of_100_ms: Option<f64>,
}

/// Frames of the measured part.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameCounts {
    /// Due.
    #[serde(rename = "in")]
    pub taken_in: usize,
    /// Came out.
    pub out: usize,
    /// Overtaken by a newer one; they count in `end_to_end_us`.
    pub dropped: usize,
    /// Nothing newer came either: counted with a lower bound.
    pub unanswered: usize,
    /// Before the measurement, in no figure.
    pub warm_up: usize,
}

/// The first frame after the start, worst of all rounds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FirstFrame {
    /// End to end; `None`: it was dropped.
    pub latency_us: Option<f64>,
    /// Over the median of the measured frames.
    pub over_steady: Option<f64>,
    /// Computing, by stage, over the stage's median.
    pub run_over_steady: ByStage<Option<f64>>,
}

/// All figures. `report.json` is this.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// [`REPORT_VERSION`].
    pub report_version: u32,
    /// One line for the page's head.
    pub title: String,
    /// What a reader must know before believing a figure.
    pub warnings: Vec<String>,
    /// From due to objects, every frame.
    pub end_to_end_us: Percentiles,
    /// The same of the frames that came out.
    pub end_to_end_delivered_us: Percentiles,
    /// By stage.
    pub stages: ByStage<StageReport>,
    /// By topic.
    pub hops: ByHop<Hop>,
    /// Together.
    pub hops_together: HopsTogether,
    /// Counts.
    pub frames: FrameCounts,
    /// After the start.
    pub first_frame: FirstFrame,
    /// How quiet the machine was.
    pub quiet: Map<String, Value>,
    /// Processor, cores, memory, kernel, governor.
    pub machine: Map<String, Value>,
    /// Version, commit, compiler.
    pub build: Map<String, Value>,
    /// What ran.
    pub scenario: Map<String, Value>,
    /// Stamps and spans: on or off, and what a stamp costs.
    pub instrumentation: Map<String, Value>,
}

impl Report {
    /// The figures that follow from the frames; the rest is the caller's.
    pub fn of_frames(frames: &[Frame]) -> Report {
        let measured: Vec<Frame> = frames.iter().filter(|f| !f.is_warm_up).cloned().collect();
        let figures = series(&measured);
        let of = |values: &[f64]| Percentiles::of(values).unwrap_or_default();
        let end_to_end_us = of(&figures.latency_us);
        let stages = ByStage::new(|stage| StageReport {
            queue_us: of(&figures.queue_us[stage]),
            run_us: of(&figures.run_us[stage]),
            resources: Resources::default(),
        });
        let out = figures.delivered_us.len();
        Report {
            report_version: REPORT_VERSION,
            end_to_end_us,
            end_to_end_delivered_us: of(&figures.delivered_us),
            first_frame: first_frame(frames, &end_to_end_us, &stages),
            stages,
            hops: hops(&figures),
            hops_together: together(&figures.hops_together_us),
            frames: FrameCounts {
                taken_in: measured.len(),
                out,
                dropped: measured.len() - out,
                unanswered: figures.unanswered,
                warm_up: frames.len() - measured.len(),
            },
            ..Report::default()
        }
    }

    /// The period between frames by the scenario, ms.
    pub(crate) fn period_ms(&self) -> Option<f64> {
        let rate_hz = self.scenario.get("rate_hz")?.as_f64()?;
        (rate_hz > 0.0).then(|| 1000.0 / rate_hz)
    }
}

fn hops(figures: &Series) -> ByHop<Hop> {
    let hop = |topic: usize| {
        let values = &figures.hand_over_us[topic];
        let percentiles = Percentiles::of(values);
        Hop {
            frames: values.len(),
            p50_us: percentiles.map(|p| p.p50),
            p99_us: percentiles.map(|p| p.p99),
            ..Hop::default()
        }
    };
    ByHop {
        points: hop(0),
        features: hop(1),
        detections: hop(2),
        objects: hop(3),
    }
}

fn together(values: &[f64]) -> HopsTogether {
    let percentiles = Percentiles::of(values);
    HopsTogether {
        p50_us: percentiles.map(|p| p.p50),
        p99_us: percentiles.map(|p| p.p99),
        share_of_100_ms: percentiles.map(|p| p.p50 / 100_000.0),
    }
}

fn first_frame(
    frames: &[Frame],
    steady: &Percentiles,
    stages: &ByStage<StageReport>,
) -> FirstFrame {
    let firsts: Vec<&Frame> = frames.iter().filter(|frame| frame.sequence == 0).collect();
    let worst = |of: &dyn Fn(&Frame) -> Option<f64>| -> Option<f64> {
        firsts
            .iter()
            .filter_map(|frame| of(frame))
            .max_by(f64::total_cmp)
    };
    let over = |value: Option<f64>, steady: f64| value.filter(|_| steady > 0.0).map(|v| v / steady);
    let latency_us = worst(&|frame| {
        let published_ns = frame.published_ns()?;
        Some(crate::frame::micros(published_ns - frame.due_ns))
    });
    FirstFrame {
        latency_us,
        over_steady: over(latency_us, steady.p50),
        run_over_steady: ByStage::new(|stage| {
            over(
                worst(&|frame| frame.run_us(stage)),
                stages.each()[stage].run_us.p50,
            )
        }),
    }
}

/// Refuses a `report.json` of another version before anything else of it is believed.
pub fn check_version(report: &Value) -> Result<(), ReportError> {
    let found = &report["report_version"];
    match found.as_u64() {
        Some(version) if version == u64::from(REPORT_VERSION) => Ok(()),
        _ => Err(ReportError::Version {
            expected: REPORT_VERSION,
            found: found.to_string(),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::testing::{dropped, frame};

    #[test]
    fn the_keys_are_the_documented_ones() {
        let mut frames: Vec<Frame> = (0..40).map(|n| frame(n, 1000)).collect();
        frames[30] = dropped(30);
        frames[0] = frame(0, 3000);
        frames[0].is_warm_up = true;
        let report = serde_json::to_value(Report::of_frames(&frames)).unwrap();
        for pointer in [
            "/end_to_end_us/p50",
            "/end_to_end_us/p999",
            "/end_to_end_us/max",
            "/stages/backbone/queue_us/p90",
            "/stages/refiner/run_us/p99",
            "/hops/points/p50_us",
            "/hops/points/p99_us",
            "/hops/points/raw_p50_us",
            "/hops/points/raw_p99_us",
            "/hops/points/socket_p50_us",
            "/hops/features/p50_us",
            "/machine",
        ] {
            assert!(report.pointer(pointer).is_some(), "{pointer}: {report}");
        }
        assert_eq!(
            report["frames"],
            serde_json::json!({"in": 39, "out": 38, "dropped": 1, "unanswered": 0, "warm_up": 1})
        );
        assert_eq!(report["end_to_end_us"]["max"], 104_040.0);
        assert_eq!(report["end_to_end_delivered_us"]["max"], 4040.0);
        assert_eq!(report["first_frame"]["latency_us"], 12_040.0);
        assert_eq!(report["first_frame"]["run_over_steady"]["head"], 3.0);
        assert_eq!(report["hops_together"]["p50_us"], 50.0);
        assert_eq!(check_version(&report), Ok(()));
    }

    #[test]
    fn another_version_is_refused_by_name() {
        for report in [
            serde_json::json!({"report_version": 99}),
            serde_json::json!({}),
            serde_json::json!([1]),
        ] {
            let text = check_version(&report).unwrap_err().to_string();
            assert!(
                text.contains("expected 1") && text.contains("mluc bench"),
                "{text}"
            );
        }
    }

    #[test]
    fn nothing_measured_is_no_panic() {
        let report = Report::of_frames(&[]);
        assert_eq!(report.frames.taken_in, 0);
        assert_eq!(report.hops.points.p50_us, None);
    }
}
