//! Starts the four stages as processes, keeps them running, takes their objects, and ends and cleans up all of it.

mod budget;
mod child;
mod lines;
mod predecessor;
mod reload;
mod report;
mod status;

use crate::{EXIT_WARNINGS, UsageError, document, model, settings::Pace, settings::Settings};
use crate::{cli::PipelineArgs, model::PinnedModel, stages::begin_or_join_run};
use crate::{control::Control, control::ROLE};
use child::{Child, Ended};
pub(crate) use lines::LineWriter;
use mluc_ipc_types::{
    FrameHeader, Health, Object, Point, RunDescription, Stage, Status, Topic, WIRE_VERSION,
};
use mluc_model::Model;
use mluc_runtime::{HealthWatch, Input, Instance, Message, Scans, Shell, Shutdown, monotonic_ns};
use mluc_sources::{Source, idle_options};
use reload::ModelChange;
use report::Latencies;
pub(crate) use report::hops;
use rustix::process::Signal;
use status::StatusWriter;
use std::time::{Duration, Instant};
use std::{
    collections::BTreeMap, fs::File, process::ExitCode, sync::Arc, sync::atomic::AtomicBool,
};

/// A frame that leaves the pipeline: checked objects, the names of the classes, points if they are needed and still there.
pub(crate) struct Left<'a> {
    pub(crate) header: &'a FrameHeader,
    pub(crate) objects: &'a [Object],
    pub(crate) classes: &'a [String],
    pub(crate) status: &'a Status,
    pub(crate) points: &'a [Point],
}

/// Takes the frames that leave the pipeline, and writes lines about them. It must not wait: the supervisor would wait too.
pub(crate) trait Sink {
    /// Takes a frame. False: no more frames are wanted.
    fn take(&mut self, left: Left<'_>, writer: &mut LineWriter) -> anyhow::Result<bool>;

    /// Whether points are kept for [`Sink::take`].
    fn needs_points(&self) -> bool {
        false
    }

    /// The pipeline's state changed. False: no more frames are wanted.
    fn tell(&mut self, _status: &Status, _writer: &mut LineWriter) -> anyhow::Result<bool> {
        Ok(true)
    }
}

/// Where the frames that leave go.
struct Out<'a> {
    sink: &'a mut dyn Sink,
    writer: LineWriter,
}

/// How a run went.
#[derive(Debug, Default)]
pub(crate) struct Outcome {
    /// Frames that came in, and that came out, in the last run.
    pub(crate) frames_in: u64,
    pub(crate) frames_out: u64,
    /// Frames that never came out, although a later one did.
    frames_skipped: u64,
    pub(crate) restarts: u32,
    /// Names of scans that killed stages.
    pub(crate) set_aside: Vec<String>,
    pub(crate) latencies: Latencies,
    /// The status at the end.
    pub(crate) status: Status,
    /// Ended by a signal, or because the reader of the output wants no more: unfinished frames do not count as lost.
    pub(crate) is_interrupted: bool,
}

impl Outcome {
    pub(crate) fn frames_lost(&self) -> u64 {
        if self.is_interrupted {
            return self.frames_skipped;
        }
        self.frames_in.saturating_sub(self.frames_out)
    }

    pub(crate) fn exit_code(&self) -> ExitCode {
        let is_clean = self.frames_lost() == 0 && self.restarts == 0;
        let is_fine = is_clean || self.is_interrupted;
        ExitCode::from(if is_fine { 0 } else { EXIT_WARNINGS })
    }
}

/// How long stages may take to end when asked, before they are killed. The whole end takes less than a second.
const END_PATIENCE: Duration = Duration::from_millis(600);
/// Number of deaths of stages that work on a scan, from which the scan is set aside.
const KILLS_MAX: u32 = 2;
const POLL_INTERVAL: Duration = Duration::from_millis(10);
/// If the supervisor itself pauses for this long, nothing is known about the stages in that time.
const PAUSE_NS: u64 = 500_000_000;

struct Supervisor {
    args: PipelineArgs,
    settings: Settings,
    /// Set by SIGHUP.
    is_asked_to_reload: Arc<AtomicBool>,
    classes: Vec<String>,
    run: RunDescription,
    objects: Input<Object>,
    /// The scans that ingest has sent; they are kept if the sink needs points.
    scans: Scans,
    health: HealthWatch,
    status: StatusWriter,
    // The ports are dropped before the shell.
    shell: Shell,
    children: Vec<Child>,
    /// The input, if ingest reads files.
    source: Option<Source>,
    /// How many deaths each scan has caused.
    kills: BTreeMap<u64, u32>,
    control: Control,
    is_control_untold: bool,
    /// The settings as the stages have them.
    document: File,
    model: PinnedModel,
    model_change: Option<ModelChange>,
    next_sequence: u64,
    /// The time of the last check of the stages, and since when there was no pause between two checks.
    looked_ns: u64,
    regular_since_ns: u64,
    outcome: Outcome,
}

/// Returns how a run went, and how many lines were dropped. `args`: the arguments that gave `settings`, for a reload.
pub(crate) fn run(
    args: PipelineArgs,
    settings: Settings,
    shutdown: Shutdown,
    sink: &mut dyn Sink,
) -> anyhow::Result<(Outcome, anyhow::Result<u64>)> {
    let writer = LineWriter::new(settings.pace);
    let mut out = Out { sink, writer };
    let outcome = supervise(args, settings, shutdown.clone(), &mut out);
    let is_asked = || shutdown.is_requested();
    let dropped = out.writer.finish(outcome.is_err(), is_asked);
    Ok((outcome?, dropped))
}

fn supervise(
    args: PipelineArgs,
    mut settings: Settings,
    shutdown: Shutdown,
    out: &mut Out,
) -> anyhow::Result<Outcome> {
    let is_asked_to_reload = mluc_runtime::reload_flag()?;
    // First: an ingest that is left may hold the input's port.
    predecessor::end_orphans(&settings.instance);
    let (source, model) = check_before(&settings)?;
    if !settings.complete_from(&model) {
        let (name, variant) = (&settings.model, settings.refiner.variant.name());
        tracing::warn!(
            "model '{name}' has no scores for the operating profiles with the refiner {variant}: it runs as with --profile all"
        );
    }
    let mut shell = Shell::observer(&settings.instance, Some(ROLE), shutdown)?;
    if shell.has_dead() {
        predecessor::clean(&settings.instance)?;
    }
    Control::default().write(&settings.instance)?;
    let pinned = PinnedModel::new(&mut settings, &model, 0)?;
    let document = document::publish(&settings)?;
    let Some(run) = begin_or_join_run(&mut shell, &settings, &model)? else {
        return Ok(Outcome { is_interrupted: true, ..Outcome::default() });
    };
    let sensor = settings.sensor.load()?;
    let status = StatusWriter::open(&mut shell, &settings, sensor.as_ref())?;
    let mut supervisor = Supervisor {
        run,
        scans: Scans::open(&shell, out.sink.needs_points())?,
        objects: shell.input::<Object>(&Topic::OBJECTS)?,
        health: shell.health_watch()?,
        status,
        shell,
        args,
        settings,
        is_asked_to_reload,
        classes: model.manifest.class_names(),
        children: Vec::new(),
        source,
        kills: BTreeMap::new(),
        control: Control::default(),
        is_control_untold: false,
        document,
        model: pinned,
        model_change: None,
        next_sequence: 0,
        looked_ns: 0,
        regular_since_ns: 0,
        outcome: Outcome::default(),
    };
    drop(model);
    let result = supervisor.supervise(out);
    let why = match (&result, supervisor.outcome.is_interrupted) {
        (Err(_), _) => "the pipeline failed",
        (_, true) => "asked to end",
        _ => "the input ended",
    };
    let told = supervisor.tell_status(out, Some(why));
    supervisor.end_all();
    // Takes the last heartbeats of the stages.
    supervisor.health.update()?;
    supervisor.outcome.status = (supervisor.status).count(&supervisor.health, &supervisor.outcome);
    result.and(told).map(|_| supervisor.outcome)
}

/// Whether ingest ended because somebody asked it to, and not at the end of its input.
fn was_asked(health: &mut HealthWatch) -> anyhow::Result<bool> {
    health.update()?;
    let ingest = health.of(Stage::Ingest);
    Ok(ingest.is_some_and(|health| health.reason() == Health::ASKED_TO_END))
}

/// Checks input and model, so that an error is reported here once and not by four processes.
fn check_before(settings: &Settings) -> anyhow::Result<(Option<Source>, Model)> {
    for stage in Stage::ALL {
        if let Err(error) = settings.stages[stage].check_right(stage.name()) {
            tracing::warn!("{error}; the stage runs without it");
        }
    }
    let is_foreign = |stage: Stage| settings.stages[stage].command.is_some();
    let (own, default) = (settings, Settings::default());
    let has_scores = own.min_score.or(own.min_unknown_score).is_some() || own.track.is_some();
    let has_others = own.profile != default.profile || own.robot != default.robot;
    if is_foreign(Stage::Refiner) && (has_scores || has_others) {
        let whose = "are for our own refiner: the program in its place chooses by itself";
        tracing::warn!("profile, min_score, min_unknown_score, [robot] and track {whose}");
    }
    let is_timed = own.pace == Pace::Complete || own.seconds.is_some();
    if is_foreign(Stage::Ingest) && (is_timed || own.repeat) {
        let whose = "are for our own ingest: the program in its place sends as it likes";
        tracing::warn!("pace, seconds and loop {whose}");
    }
    let input = settings.input.as_deref();
    for option in input.map_or(vec![], |input| idle_options(input, &settings.layout)) {
        tracing::warn!("{option} has no effect on this input");
    }
    let ingest = &settings.stages.ingest;
    let is_elsewhere = settings.reads_ros2();
    let source = if is_elsewhere { None } else { settings.source(Source::open)? };
    if source.is_none() && !is_elsewhere && ingest.command.is_none() && !ingest.external {
        let text = "--input is missing: scans (a file or a folder), a capture, a recording, udp:PORT or ros2:/TOPIC (`mluc up --help`)";
        return Err(UsageError(text.to_string()).into());
    }
    // Ingest needs the socket, and a live scan cannot be read again.
    let source = source.filter(|source| !source.is_live());
    Ok((source, model::load_for(settings)?))
}

impl Supervisor {
    fn supervise(&mut self, out: &mut Out) -> anyhow::Result<()> {
        for stage in Stage::ALL {
            let mut child = Child::new(stage);
            if self.settings.stages[stage].external {
                let (name, instance) = (stage.name(), self.settings.instance.name());
                let variable = Instance::VARIABLE;
                tracing::info!(
                    "{name} is left to you: mluc stage {name} --instance {instance}; or a program of yours with {variable}={instance}"
                );
            } else {
                child.start(&self.settings, 0)?;
            }
            self.children.push(child);
        }
        loop {
            self.shell.tick()?;
            self.follow_run();
            self.health.update()?;
            if self.is_ready() {
                self.shell.say_ready();
            }
            let is_wanted = self.take_objects(out)? && self.tell_status(out, None)?;
            if self.shell.is_stopping() || !is_wanted {
                self.outcome.is_interrupted = true;
                return Ok(());
            }
            self.reload_if_asked();
            let holds = out.writer.is_behind();
            if holds != self.control.holds || self.is_control_untold {
                self.control.holds = holds;
                self.tell_stages();
            }
            if self.look_after_children()? {
                // Ingest ends after the last objects; they are in the queue now.
                self.health.update()?;
                self.take_objects(out)?;
                self.take_scans()?;
                return Ok(());
            }
            self.objects.wait(POLL_INTERVAL);
        }
    }

    /// Whether our own stages take frames, or were given up.
    fn is_ready(&self) -> bool {
        let is_own = |stage: &Stage| {
            let own = &self.settings.stages[*stage];
            !own.external && own.command.is_none()
        };
        let mut own = Stage::ALL.into_iter().filter(is_own);
        let is_given_up = |stage| self.children[stage as usize].is_given_up(&self.settings);
        own.all(|stage| self.health.is_ready(stage) || is_given_up(stage))
    }

    /// Follows a new run that another process has begun: it begins at frame 0.
    fn follow_run(&mut self) {
        if let Some(run) = self.shell.run()
            && run.run_id != self.run.run_id
        {
            tracing::warn!("a new run began: sequences and counts start again");
            (self.run, self.next_sequence) = (*run, 0);
            self.shell.note_frame(None);
            let own = &mut self.outcome;
            (own.frames_in, own.frames_out, own.frames_skipped) = (0, 0, 0);
        }
    }

    fn take_scans(&mut self) -> anyhow::Result<()> {
        let (status, run) = (&mut self.status, &self.run);
        self.scans.take(run, |scan| status.see(run, scan))?;
        self.outcome.frames_in = self.outcome.frames_in.max(self.scans.count_sent());
        Ok(())
    }

    /// Judges and publishes the pipeline's state. False: the sink wants no more.
    fn tell_status(&mut self, out: &mut Out, end: Option<&str>) -> anyhow::Result<bool> {
        self.take_scans()?;
        let changed = (self.status).tick(&self.run, &self.health, &self.outcome, end)?;
        changed.map_or(Ok(true), |status| out.sink.tell(&status, &mut out.writer))
    }

    /// False: the sink wants no more.
    fn take_objects(&mut self, out: &mut Out) -> anyhow::Result<bool> {
        // Bounded: a refiner that publishes without pause must not block the supervisor.
        for _ in 0..2 * Topic::OBJECTS.buffer {
            let Some(message) = self.objects.oldest()? else {
                break;
            };
            let header = *message.header();
            self.take_scans()?;
            // A refiner that outlived a run may still publish the last message of that run.
            if header.wire_version == WIRE_VERSION && header.run_id != self.run.run_id {
                let sequence = header.sequence;
                tracing::debug!(sequence, "objects of another run left out");
                continue;
            }
            let sent = self.scans.count_sent();
            if header.sequence < sent {
                // Ingest at pace `complete` waits for this note: the queue here has room for only two messages.
                self.shell.note_frame(Some(header.sequence));
            }
            // A copy: a refiner that goes on writing cannot change what was checked.
            let elements = message.elements().to_vec();
            let checked = header
                .checked_in(&self.run, 0..sent)
                .and_then(|_| Object::checked(&header, &elements, self.classes.len()));
            let objects = match checked {
                Ok(objects) => objects,
                Err(error) => {
                    self.shell.refuse(&format!("objects: {error}"))?;
                    continue;
                }
            };
            // The objects of a frame that was sent again may come twice.
            if header.sequence < self.next_sequence {
                continue;
            }
            if header.sequence > self.next_sequence {
                let (first, last) = (self.next_sequence, header.sequence - 1);
                tracing::warn!(first, last, "frames lost: newer ones overtook them");
                self.outcome.frames_skipped += header.sequence - self.next_sequence;
            }
            self.next_sequence = header.sequence + 1;
            self.outcome.frames_in = self.outcome.frames_in.max(self.next_sequence);
            self.outcome.frames_out += 1;
            self.outcome.latencies.record(&header);
            self.status.record(&self.run, &header);
            if !self.tell_status(out, None)? {
                return Ok(false);
            }
            let scan = self.scans.of(header.sequence);
            let left = Left {
                header: &header,
                objects,
                classes: &self.classes,
                status: &self.status.current,
                points: scan.map_or(&[][..], Message::elements),
            };
            if !out.sink.take(left, &mut out.writer)? {
                return Ok(false);
            }
            self.scans.let_go();
        }
        Ok(true)
    }

    /// Restarts stages that died. True: ingest has come to the end of its input.
    fn look_after_children(&mut self) -> anyhow::Result<bool> {
        let now_ns = monotonic_ns();
        if now_ns - self.looked_ns > PAUSE_NS {
            self.regular_since_ns = now_ns;
        }
        self.looked_ns = now_ns;
        let mut killed_by = vec![];
        for child in &mut self.children {
            let ended = child.watch(&self.health, &self.settings, self.regular_since_ns)?;
            match ended {
                Ended::No => (),
                Ended::Done if child.stage == Stage::Ingest && !was_asked(&mut self.health)? => {
                    return Ok(true);
                }
                Ended::Done | Ended::Hit | Ended::Died(_) => {
                    if self.shell.is_stopping() {
                        continue;
                    }
                    child.plan_restart();
                }
            }
            if let Ended::Died(Some(sequence)) = ended {
                killed_by.push((child.stage, sequence));
            }
        }
        // This comes before the restart, so that the scan is not sent a third time.
        for (stage, sequence) in killed_by {
            self.blame(stage, sequence);
        }
        // Counts all scans that the ended ingest has sent.
        self.take_scans()?;
        let start_sequence = self.start_sequence();
        for child in self.children.iter_mut().filter(|child| child.is_due()) {
            self.outcome.restarts += 1;
            self.control.restarts[child.stage as usize] += 1;
            self.is_control_untold = true;
            child.restart(&self.settings, start_sequence)?;
        }
        Ok(false)
    }

    /// Counts the death of a stage that was working on a frame. A scan that causes two deaths is set aside.
    fn blame(&mut self, stage: Stage, sequence: u64) {
        let Some(source) = &self.source else {
            return;
        };
        let index = source.index(sequence);
        let kills = self.kills.entry(index).or_default();
        *kills += 1;
        if *kills < KILLS_MAX || !self.control.set_aside.insert(index) {
            return;
        }
        let (scan, stage) = (source.name(index), stage.name());
        tracing::error!(scan, stage, "stages died of this scan {kills} times: set aside");
        self.outcome.set_aside.push(scan);
        self.tell_stages();
    }

    /// Writes the control file. If this fails (shared memory may be full), the run goes on, and the write is tried again.
    fn tell_stages(&mut self) {
        let written = self.control.write(&self.settings.instance);
        self.is_control_untold = written.is_err();
        if let Err(error) = written {
            tracing::error!("informing the stages of a change: {error:#}");
        }
    }

    fn start_sequence(&self) -> u64 {
        match self.settings.pace {
            // The scan is sent again. A live sensor's scan is gone, so its next scan has a new sequence.
            Pace::Complete if self.source.is_some() => self.next_sequence,
            _ => self.next_sequence.max(self.scans.count_sent()),
        }
    }

    /// Sends SIGTERM to all stages, and SIGKILL to those that stay: nothing is left running.
    fn end_all(&mut self) {
        for child in &mut self.children {
            child.signal(Signal::TERM);
        }
        let begun = Instant::now();
        let is_early = || begun.elapsed() < END_PATIENCE;
        while self.children.iter_mut().any(Child::is_running) && is_early() {
            std::thread::sleep(Duration::from_millis(5));
        }
        for child in &mut self.children {
            child.kill();
        }
    }
}
