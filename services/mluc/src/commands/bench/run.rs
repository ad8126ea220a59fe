//! From rounds to a report.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context;
use mluc_report::{Frame, Report, Resources, STAGES, Sample};
use mluc_runtime::monotonic_ns;
use serde_json::{Map, Value, json};

use super::arguments::Instrumentation;
use super::floors::add_floors;
use super::folder;
use super::machine::{describe_build, describe_machine};
use super::plan::{Plan, Variant};
use super::progress::Progress;
use super::quality::Boxes;
use super::quiet::Quiet;
use super::round::Round;
use super::summary;
use super::trace::SPANS_VARIABLE;
use crate::EXIT_WARNINGS;
use crate::terminal::answer;

/// All rounds of one variant.
#[derive(Default)]
pub(super) struct Measured {
    pub(super) frames: Vec<Frame>,
    pub(super) samples: Vec<Sample>,
    pub(super) boxes: Vec<(String, Boxes)>,
    resources: Vec<[Resources; 4]>,
    payload_bytes: [u64; 4],
    is_heard: [bool; 4],
    restarts: u32,
    is_interrupted: bool,
    load_ended: bool,
}

impl Measured {
    pub(super) fn add(&mut self, round: Round) {
        let offset_s = self.samples.last().map_or(0.0, |sample| sample.at_s + 1.0);
        self.samples
            .extend(round.samples.into_iter().map(|sample| Sample {
                at_s: sample.at_s + offset_s,
                ..sample
            }));
        self.frames.extend(round.frames);
        for (name, boxes) in round.boxes {
            if self.boxes.iter().all(|(seen, _)| *seen != name) {
                self.boxes.push((name, boxes));
            }
        }
        self.resources.push(round.resources);
        for stage in 0..STAGES.len() {
            self.payload_bytes[stage] = self.payload_bytes[stage].max(round.payload_bytes[stage]);
            self.is_heard[stage] |= round.is_heard[stage];
        }
        self.restarts += round.restarts;
        self.is_interrupted |= round.is_interrupted;
        self.load_ended |= round.load_ended;
    }

    pub(super) fn is_interrupted(&self) -> bool {
        self.is_interrupted
    }

    /// Means over the rounds; of memory the largest.
    fn resources_of(&self, stage: usize) -> Resources {
        let each = || self.resources.iter().map(|round| &round[stage]);
        let mean = |of: &dyn Fn(&Resources) -> f64| {
            each().map(of).sum::<f64>() / self.resources.len().max(1) as f64
        };
        let most = |of: &dyn Fn(&Resources) -> f64| each().map(of).fold(0.0, f64::max);
        Resources {
            threads: each().map(|r| r.threads).max().unwrap_or(0),
            cpu_cores: mean(&|r| r.cpu_cores),
            memory_mib: most(&|r| r.memory_mib),
            shared_memory_mib: most(&|r| r.shared_memory_mib),
            switches_voluntary_per_s: mean(&|r| r.switches_voluntary_per_s),
            switches_forced_per_s: mean(&|r| r.switches_forced_per_s),
            waiting_for_cpu: mean(&|r| r.waiting_for_cpu),
        }
    }

    /// The report of a variant, without the floors.
    pub(super) fn report(&self, plan: &Plan, variant: &Variant, quiet: &Quiet) -> Report {
        let mut report = Report::of_frames(&self.frames);
        let stages = &mut report.stages;
        let each = [
            &mut stages.ingest,
            &mut stages.backbone,
            &mut stages.head,
            &mut stages.refiner,
        ];
        for (number, stage) in each.into_iter().enumerate() {
            stage.resources = self.resources_of(number);
        }
        // As it was asked for: models of one setting share the manifest's name.
        let model = &variant.settings.model;
        report.title = format!(
            "mluc bench: {model}, {}, {} Hz, {}",
            variant.settings.precision, plan.rate_hz, plan.scans
        );
        report.quiet = quiet.describe();
        report.machine = describe_machine();
        report.build = describe_build();
        report.scenario = plan.describe(variant);
        report.instrumentation = instrumentation(variant);
        report.warnings = self.warnings(plan, &report, quiet);
        if report.instrumentation["stamps"] == json!("off") {
            report.warnings.push(
                "Stamps were off: only the latency end to end means anything here.".to_string(),
            );
        }
        report
    }

    fn warnings(&self, plan: &Plan, report: &Report, quiet: &Quiet) -> Vec<String> {
        let mut warnings = Vec::new();
        let mut warn = |is_so: bool, text: String| {
            if is_so {
                warnings.push(text);
            }
        };
        let (verdict, is_loud) = quiet.verdict();
        warn(is_loud, format!("The machine was {verdict}."));
        let counts = &report.frames;
        warn(
            counts.dropped > 0,
            format!(
                "{} of {} frames were dropped: the pipeline does not keep up with {} Hz here, or something stalled it.",
                counts.dropped, counts.taken_in, plan.rate_hz
            ),
        );
        warn(
            counts.unanswered > 0,
            format!(
                "Nothing came out after the last {} frames were due: a stage stopped answering; their latency is a lower bound.",
                counts.unanswered
            ),
        );
        warn(
            self.restarts > 0,
            format!(
                "Stages ended and were started again {} times.",
                self.restarts
            ),
        );
        warn(
            self.is_interrupted,
            "The run was interrupted: less was measured than asked for.".to_string(),
        );
        warn(
            self.load_ended,
            "The load beside the pipeline ended before the run did.".to_string(),
        );
        warn(
            cfg!(debug_assertions),
            "The program was built without optimisation: none of these figures means anything."
                .to_string(),
        );
        warn(
            plan.model.manifest.provenance.steps == 0,
            "The model was never trained: the number of its boxes, and so the refiner's work, is accidental.".to_string(),
        );
        let flagged = |flag: &str| {
            self.frames
                .iter()
                .filter(|frame| frame.flags.split(' ').any(|word| word == flag))
                .count()
        };
        let degraded = flagged("degraded");
        warn(
            degraded > 0,
            format!(
                "{degraded} frames are flagged degraded: a stage could not do all of its work."
            ),
        );
        for (name, is_heard) in STAGES.iter().zip(self.is_heard) {
            warn(
                !is_heard,
                format!(
                    "{name} told no health: a program that is not ours; its stamps are its own word."
                ),
            );
        }
        let steady = report.first_frame.over_steady.unwrap_or(0.0);
        warn(
            steady > 2.0,
            format!(
                "The first frame took {steady:.1} times as long as the median one; more than 2 says that something was not warm."
            ),
        );
        warnings
    }
}

fn instrumentation(variant: &Variant) -> Map<String, Value> {
    let has = |key: &str| {
        variant
            .settings
            .environment
            .iter()
            .any(|(name, _)| *name == key)
    };
    let word = |is_on: bool| if is_on { "on" } else { "off" };
    let mut map = Map::new();
    map.insert(
        "stamps".to_string(),
        json!(word(!has(crate::stages::STAMPS_VARIABLE))),
    );
    map.insert("spans".to_string(), json!(word(has(SPANS_VARIABLE))));
    map.insert("stamps_cost_us_a_hop".to_string(), json!(stamps_cost_us()));
    map
}

/// What a stage's three stamps cost, us: three readings of the clock and three writes.
fn stamps_cost_us() -> f64 {
    const TIMES: u32 = 1000;
    let mut header = mluc_ipc_types::FrameHeader::new(0, "cost");
    let mut batch_us = || {
        let begun_ns = monotonic_ns();
        for _ in 0..TIMES {
            let stamps = header.stamps_mut(mluc_ipc_types::Stage::Head);
            stamps.received_ns = monotonic_ns();
            stamps.started_ns = monotonic_ns();
            stamps.published_ns = monotonic_ns();
            std::hint::black_box(&mut header);
        }
        (monotonic_ns() - begun_ns) as f64 / 1000.0 / f64::from(TIMES)
    };
    // The median batch: one that was interrupted tells of the machine.
    let mut batches: Vec<f64> = (0..51).map(|_| batch_us()).collect();
    batches.sort_by(f64::total_cmp);
    (batches[batches.len() / 2] * 1e4).round() / 1e4
}

/// Where the processes write their spans, for as long as the measurement lasts.
pub(super) struct SpansFolder(PathBuf);

impl SpansFolder {
    pub(super) fn make(out: &Path) -> anyhow::Result<SpansFolder> {
        let folder = out.join("spans");
        fs::create_dir_all(&folder).with_context(|| format!("making {}", folder.display()))?;
        // Stages find it whatever folder they run in.
        let folder =
            fs::canonicalize(&folder).with_context(|| format!("finding {}", folder.display()))?;
        Ok(SpansFolder(folder))
    }

    pub(super) fn path(&self) -> &Path {
        &self.0
    }

    pub(super) fn variable(&self) -> (&'static str, String) {
        (SPANS_VARIABLE, self.0.display().to_string())
    }
}

impl Drop for SpansFolder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// One pipeline, one report.
pub(super) fn single(plan: &Plan) -> anyhow::Result<ExitCode> {
    folder::make(&plan.out)?;
    let variant = &plan.variants[0];
    let mut settings = variant.settings.clone();
    let spans = match plan.trace {
        Some(_) => Some(SpansFolder::make(&plan.out)?),
        None => None,
    };
    settings
        .environment
        .extend(spans.as_ref().map(SpansFolder::variable));
    let variant = Variant {
        name: variant.name.clone(),
        settings,
    };
    let mut quiet = Quiet::new();
    let mut progress = Progress::new();
    let mut measured = Measured::default();
    for round in 0..plan.rounds {
        measured.add(super::round::run_round(
            plan,
            &variant,
            [round, round],
            &mut quiet,
            &mut progress,
        )?);
        if measured.is_interrupted() {
            break;
        }
    }
    let mut report = measured.report(plan, &variant, &quiet);
    finish(plan, &measured, &mut report, &mut progress);
    drop(progress);
    folder::write(&plan.out, &report, &measured.frames, &measured.samples)?;
    answer(summary::table(&report).trim_end())?;
    answer(format_args!(
        "report: {}",
        plan.out.join("report.html").display()
    ))?;
    if let (Some(wish), Some(spans)) = (&plan.trace, &spans) {
        let trace = wish.write(spans.path(), &measured.frames)?;
        answer(format_args!("trace of {trace}"))?;
    }
    Ok(exit_code(&report, &measured))
}

/// The floors, unless somebody is in a hurry.
pub(super) fn finish(
    plan: &Plan,
    measured: &Measured,
    report: &mut Report,
    progress: &mut Progress,
) {
    let rounds = match measured.is_interrupted || plan.instrumentation == Instrumentation::Off {
        true => 0,
        false => plan.floor_rounds,
    };
    let warning = add_floors(&mut report.hops, measured.payload_bytes, rounds, progress);
    report.warnings.extend(warning);
}

/// 3: something is in the report that should not be there.
pub(super) fn exit_code(report: &Report, measured: &Measured) -> ExitCode {
    let is_flawed = report.frames.dropped > 0
        || report.frames.unanswered > 0
        || measured.restarts > 0
        || measured.is_interrupted;
    ExitCode::from(if is_flawed { EXIT_WARNINGS } else { 0 })
}
