//! All rounds, and the report of them.

use anyhow::Result;
use indicatif::ProgressBar;
use serde_json::{Value, json};

use super::pipeline::{Recording, record};
use super::plan::Plan;
use super::quiet::Quiet;
use super::round::frames;
use crate::machine::{describe_build, describe_machine};
use crate::report::{FrameRecord, HOPS, Resources, STAGES, number, report_of};

#[derive(Default)]
pub(crate) struct Measured {
    pub(crate) frames: Vec<FrameRecord>,
    payload_bytes: [u64; 4],
    pub(crate) is_interrupted: bool,
    /// By round and stage.
    resources: Vec<[Resources; 4]>,
    is_heard: [bool; 4],
    restarts: u32,
}

impl Measured {
    /// Starts the processes once more.
    pub(crate) fn add_round(
        &mut self,
        plan: &Plan,
        round: u32,
        quiet: &mut Quiet,
        progress: &ProgressBar,
    ) -> Result<()> {
        let what = match plan.rounds {
            1 => plan.refiner.clone(),
            all => format!("{}, {} of {all}", plan.refiner, round + 1),
        };
        let run = || record(plan, round, &what, progress);
        let recording = quiet.watch(run)?;
        let clock = (plan.rate_hz, plan.warm_up_seconds);
        let arrived = (&recording.arrivals[..], recording.frames_in);
        self.frames.extend(frames(round, clock, arrived));
        self.add(recording);
        Ok(())
    }

    fn add(&mut self, recording: Recording) {
        let stages = recording.watch.stages;
        self.resources.push(stages.map(|stage| stage.resources()));
        for stage in 0..STAGES.len() {
            let bytes = recording.payload_bytes[stage];
            self.payload_bytes[stage] = self.payload_bytes[stage].max(bytes.unwrap_or(0));
            self.is_heard[stage] |= bytes.is_some();
        }
        self.restarts += recording.restarts;
        self.is_interrupted |= recording.is_interrupted;
    }

    /// Something is in the report that should not be there.
    pub(crate) fn is_flawed(&self, report: &Value) -> bool {
        let lost = ["/frames/dropped", "/frames/unanswered"];
        let is_lost = lost.iter().any(|count| number(report, count) > Some(0.0));
        is_lost || self.restarts > 0 || self.is_interrupted
    }

    /// Means over the rounds; of memory the largest.
    fn resources_of(&self, stage: usize) -> Resources {
        let each = || self.resources.iter().map(|round| &round[stage]);
        let mean = |of: fn(&Resources) -> f64| {
            each().map(of).sum::<f64>() / self.resources.len().max(1) as f64
        };
        let most = |of: fn(&Resources) -> f64| each().map(of).fold(0.0, f64::max);
        Resources {
            threads: each().map(|r| r.threads).max().unwrap_or(0),
            cpu_cores: mean(|r| r.cpu_cores),
            memory_mib: most(|r| r.memory_mib),
            shared_memory_mib: most(|r| r.shared_memory_mib),
            switches_voluntary_per_s: mean(|r| r.switches_voluntary_per_s),
            switches_forced_per_s: mean(|r| r.switches_forced_per_s),
            waiting_for_cpu: mean(|r| r.waiting_for_cpu),
        }
    }

    /// The whole report.
    pub(crate) fn report(&self, plan: &Plan, quiet: &Quiet) -> Value {
        let mut report = report_of(&self.frames);
        report["title"] = plan.title().into();
        report["quiet"] = quiet.describe();
        report["machine"] = describe_machine();
        report["build"] = describe_build(&plan.program);
        report["scenario"] = plan.describe();
        for (stage, name) in STAGES.iter().enumerate() {
            report["stages"][name]["resources"] = json!(self.resources_of(stage));
        }
        for (hop, bytes) in HOPS.iter().zip(self.payload_bytes) {
            report["hops"][hop]["payload_bytes"] = bytes.into();
        }
        report["warnings"] = self.warnings(plan, &report, quiet).into();
        report
    }

    fn warnings(&self, plan: &Plan, report: &Value, quiet: &Quiet) -> Vec<String> {
        let (verdict, is_loud) = quiet.verdict();
        let count = |key: &str| report["frames"][key].as_u64().unwrap_or(0);
        let (dropped, taken_in, unanswered) = (count("dropped"), count("in"), count("unanswered"));
        let (rate_hz, restarts) = (plan.rate_hz, self.restarts);
        let is_degraded = |frame: &&FrameRecord| frame.flags.split(' ').any(|f| f == "degraded");
        let degraded = self.frames.iter().filter(is_degraded).count();
        let steady = number(report, "/first_frame/over_steady").unwrap_or(0.0);
        let mut warnings = Vec::new();
        let mut warn = |is_so: bool, text: String| warnings.extend(is_so.then_some(text));
        warn(is_loud, format!("The machine was {verdict}."));
        warn(
            dropped > 0,
            format!(
                "{dropped} of {taken_in} frames were dropped: the pipeline does not keep up with {rate_hz} Hz here, or something stalled it."
            ),
        );
        warn(
            unanswered > 0,
            format!(
                "Nothing came out after the last {unanswered} frames were due: a stage stopped answering; their latency is a lower bound."
            ),
        );
        warn(
            restarts > 0,
            format!("Stages ended and were started again {restarts} times."),
        );
        warn(
            self.is_interrupted,
            "The run was interrupted: less was measured than asked for.".into(),
        );
        warn(
            cfg!(debug_assertions),
            "The program was built without optimisation: none of these figures means anything."
                .into(),
        );
        warn(
            plan.model.manifest.provenance.steps == 0,
            "The model was never trained: the number of its boxes, and so the refiner's work, is accidental.".into(),
        );
        warn(
            degraded > 0,
            format!(
                "{degraded} frames are flagged degraded: a stage could not do all of its work."
            ),
        );
        warn(
            steady > 2.0,
            format!(
                "The first frame took {steady:.1} times as long as the median one; more than 2 says that something was not warm."
            ),
        );
        for (name, is_heard) in STAGES.iter().zip(self.is_heard) {
            warn(
                !is_heard,
                format!(
                    "{name} sent no heartbeat: a program that is not ours; its stamps are its own word."
                ),
            );
        }
        warnings
    }
}
