//! Measures this build: all rounds of one pipeline, and their report.

use super::pipeline::{Recording, record};
use super::{folder, plan::Plan, progress, quiet::Quiet, round::frames};
use crate::machine::{describe_build, describe_machine};
use crate::report::{FrameRecord, HOPS, Resources, STAGES, number, render, report_of, table};
use anyhow::Result;
use indicatif::ProgressBar;
use mluc::{EXIT_WARNINGS, terminal::print_out};
use serde_json::{Value, json};
use std::process::ExitCode;

pub(crate) fn measure(plan: &Plan) -> Result<ExitCode> {
    let out = &plan.args.out;
    folder::make(out)?;
    let progress = progress();
    let (mut quiet, mut measured) = (Quiet::new(), Measured::default());
    for round in 0..plan.rounds {
        measured.add_round(plan, round, &mut quiet, &progress)?;
        if measured.is_interrupted {
            break;
        }
    }
    let report = measured.report(plan, &quiet)?;
    drop(progress);
    folder::write(out, &report, &measured.frames)?;
    print_out(table(&report)?.trim_end())?;
    let page = out.join("report.html");
    print_out(format_args!("report: {}", page.display()))?;
    let is_flawed = measured.is_flawed(&report);
    Ok(ExitCode::from(if is_flawed { EXIT_WARNINGS } else { 0 }))
}

#[derive(Default)]
struct Measured {
    frames: Vec<FrameRecord>,
    payload_bytes: [u64; 4],
    is_interrupted: bool,
    /// By round and stage.
    resources: Vec<[Resources; 4]>,
    restarts: u32,
}

impl Measured {
    /// Starts the processes once more and adds what was recorded.
    fn add_round(
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
            self.payload_bytes[stage] = self.payload_bytes[stage].max(bytes);
        }
        self.restarts += recording.restarts;
        self.is_interrupted |= recording.is_interrupted;
    }

    /// Whether frames were lost, a stage was restarted or the run was interrupted.
    fn is_flawed(&self, report: &Value) -> bool {
        let lost = ["/frames/dropped", "/frames/unanswered"];
        let is_lost = lost.iter().any(|count| number(report, count) > Some(0.0));
        is_lost || self.restarts > 0 || self.is_interrupted
    }

    /// Resources of a stage: means over the rounds; for memory and threads the largest value.
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
            switches_forced_per_s: mean(|r| r.switches_forced_per_s),
            waiting_for_cpu: mean(|r| r.waiting_for_cpu),
        }
    }

    fn report(&self, plan: &Plan, quiet: &Quiet) -> Result<Value> {
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
        report["warnings"] = self.warnings(plan, &report, quiet)?.into();
        Ok(report)
    }

    /// Warnings for the reader: the lines that the template gives.
    fn warnings(&self, plan: &Plan, report: &Value, quiet: &Quiet) -> Result<Vec<String>> {
        let (verdict, is_loud) = quiet.verdict();
        let is_degraded = |frame: &&FrameRecord| frame.flags.split(' ').any(|f| f == "degraded");
        let values = json!({
            "frames": report["frames"],
            "over_steady": report["first_frame"]["over_steady"],
            "loud": is_loud.then_some(verdict),
            "rate_hz": plan.rate_hz.to_string(),
            "restarts": self.restarts,
            "is_interrupted": self.is_interrupted,
            "is_slow": cfg!(debug_assertions),
            "is_untrained": plan.model.manifest.provenance.steps == 0,
            "degraded": self.frames.iter().filter(is_degraded).count(),
        });
        let text = render("warnings.txt", include_str!("warnings.txt"), values)?;
        let lines = text.lines().filter(|line| !line.is_empty());
        Ok(lines.map(str::to_string).collect())
    }
}
