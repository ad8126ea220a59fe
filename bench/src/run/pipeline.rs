//! One start of `mluc up`, watched from outside as any consumer can: its objects, its heartbeats, its processes.

use super::{plan::Plan, processes::ProcessWatch, show};
use anyhow::{Context, Result, bail};
use indicatif::ProgressBar;
use mluc::{EXIT_USAGE, UsageError};
use mluc_ipc_types::{FrameHeader, Object, Stage, Topic};
use mluc_runtime::{HealthWatch, Input, Instance, Shell, Shutdown, monotonic_ns};
use rustix::process::{Pid, Signal, kill_process};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::{fs, fs::File, time::Duration, time::Instant};
use std::{os::unix::process::CommandExt, path::PathBuf};

/// Interval between two checks of the processes; a message ends the wait early.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// Time that the pipeline has to end after it was asked to.
const END_PATIENCE: Duration = Duration::from_secs(5);
/// File for what all processes of the pipeline print to stderr.
const LOG: &str = "pipeline.log";

#[derive(Clone, Copy)]
pub(crate) struct Arrival {
    pub(crate) header: FrameHeader,
    pub(crate) at_ns: u64,
}

#[derive(Default)]
pub(crate) struct Recording {
    pub(crate) arrivals: Vec<Arrival>,
    pub(crate) watch: ProcessWatch,
    /// Payload bytes of each stage's last message.
    pub(crate) payload_bytes: [u64; 4],
    pub(crate) frames_in: u64,
    pub(crate) restarts: u32,
    pub(crate) is_interrupted: bool,
}

/// Runs the pipeline once; `number` is part of the instance's name, `what` of the progress line.
pub(crate) fn record(plan: &Plan, number: u32, what: &str, bar: &ProgressBar) -> Result<Recording> {
    let instance = Instance::new(&format!("b-{}-{number}", std::process::id()))?;
    let shutdown = Shutdown::on_signals()?;
    let shell = Shell::observer(&instance, None, shutdown)?;
    let mut recorder = Recorder {
        objects: shell.input::<Object>(&Topic::OBJECTS)?,
        health: shell.health_watch()?,
        shell,
        up: Up::start(plan, &instance)?,
        pids: [0; 4],
        classes: plan.model.manifest.classes.len(),
        recording: Recording::default(),
    };
    recorder.run(plan, what, bar)?;
    Ok(recorder.recording)
}

struct Recorder {
    // Dropped first: the pipeline ends before this process leaves the instance and removes its files.
    up: Up,
    objects: Input<Object>,
    health: HealthWatch,
    shell: Shell,
    /// Process ids of the stages; 0: not known.
    pids: [u32; 4],
    classes: usize,
    recording: Recording,
}

impl Recorder {
    fn run(&mut self, plan: &Plan, what: &str, progress: &ProgressBar) -> Result<()> {
        let begun = Instant::now();
        let end_s = plan.warm_up_seconds + plan.round_seconds();
        loop {
            let ended = self.up.process.try_wait().context("watching mluc up")?;
            self.take()?;
            if self.shell.is_stopping() {
                self.recording.is_interrupted = true;
                self.up.end();
                return Ok(());
            }
            if let Some(status) = ended {
                return self.up.check(status);
            }
            self.find_stages();
            if let Some(at_s) = self.recording.at_s() {
                let is_measured = at_s >= plan.warm_up_seconds;
                let watch = &mut self.recording.watch;
                watch.look(at_s, is_measured, self.pids);
                let (now_s, frames) = (at_s.min(end_s), self.recording.arrivals.len());
                let text = format!("{what}: {now_s:.0} of {end_s:.0} s, {frames} frames");
                show(progress, at_s / end_s, text);
            } else {
                show(progress, 0.0, format!("{what}: starting"));
                if begun.elapsed() > plan.patience {
                    return self.give_up(plan);
                }
            }
            self.objects.wait(POLL_INTERVAL);
        }
    }

    fn take(&mut self) -> Result<()> {
        self.health.update()?;
        let recording = &mut self.recording;
        for stage in Stage::ALL {
            if let Some(health) = self.health.of(stage) {
                recording.payload_bytes[stage as usize] = health.bytes_written.into();
            }
        }
        while let Some(message) = self.objects.oldest()? {
            let at_ns = monotonic_ns();
            let header = *message.header();
            let last = recording.arrivals.last();
            let is_new = last.is_none_or(|last| header.sequence > last.header.sequence);
            match Object::checked(&header, message.elements(), self.classes) {
                Ok(_) if is_new => recording.arrivals.push(Arrival { header, at_ns }),
                // The objects of a frame that was sent again may arrive twice.
                Ok(_) => (),
                Err(error) => tracing::error!(frame = header.name(), "objects refused: {error}"),
            }
        }
        let last = recording.arrivals.last();
        let seen = last.map_or(0, |last| last.header.sequence + 1);
        let ingest = self.health.of(Stage::Ingest);
        recording.frames_in = ingest.map_or(0, |ingest| ingest.frames_out).max(seen);
        Ok(())
    }

    /// Finds the processes of the stages by their heartbeats.
    fn find_stages(&mut self) {
        let pids = Stage::ALL.map(|stage| self.health.of(stage).map_or(0, |own| own.pid));
        let stages = self.pids.iter_mut().zip(pids);
        for (pid, found) in stages.filter(|(_, found)| *found != 0) {
            self.recording.restarts += u32::from(*pid != 0 && *pid != found);
            *pid = found;
        }
    }

    fn give_up(&mut self, plan: &Plan) -> Result<()> {
        self.up.end();
        let words = Stage::ALL.map(|stage| describe(stage, &self.health));
        bail!(
            "no objects came within {} s of the start: {}; {} holds what the processes printed",
            plan.patience.as_secs_f64(),
            words.join("; "),
            self.up.log.display()
        )
    }
}

impl Recording {
    /// Seconds since the first frame that arrived was due; `None`: none arrived yet.
    fn at_s(&self) -> Option<f64> {
        let due_ns = self.arrivals.first()?.header.stages[Stage::Ingest as usize].received_ns;
        Some((monotonic_ns() as f64 - due_ns as f64) * 1e-9)
    }
}

fn describe(stage: Stage, health: &HealthWatch) -> String {
    let name = stage.name();
    let health = health.of(stage);
    match health.and_then(|health| Some((health, health.checked().ok()?.1))) {
        None => format!("{name} is silent"),
        Some((health, state)) if health.reason().is_empty() => format!("{name}: {}", state.name()),
        Some((health, state)) => format!("{name}: {} ({})", state.name(), health.reason()),
    }
}

/// A running `mluc up`; ended when dropped, and when this process ends.
struct Up {
    process: Child,
    log: PathBuf,
}

impl Up {
    fn start(plan: &Plan, instance: &Instance) -> Result<Up> {
        let log = plan.args.out.join(LOG);
        let file = File::create(&log).with_context(|| format!("creating {}", log.display()))?;
        let supervisor = std::process::id().to_string();
        let mut command = Command::new(&plan.program);
        // `exec` ends the process when this one ends, for whatever reason.
        command
            .args(["exec", "--supervised-by", &supervisor, "--"])
            .arg(&plan.program)
            .args(plan.up_arguments(instance.name()))
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(file)
            // Ctrl-C reaches only this process, which then ends the pipeline.
            .process_group(0);
        if std::env::var_os("MLUC_LOG").is_none() {
            command.env("MLUC_LOG", "error");
        }
        let starting = || format!("starting {}", plan.program.display());
        let process = command.spawn().with_context(starting)?;
        Ok(Up { process, log })
    }

    /// Checks the status of a pipeline that ended by itself: 0, or 3 if frames were lost, which the report shows too.
    fn check(&self, status: ExitStatus) -> Result<()> {
        if matches!(status.code(), Some(0 | 3)) {
            return Ok(());
        }
        // The last 20 lines of the log show why.
        let log = fs::read_to_string(&self.log).unwrap_or_default();
        let lines: Vec<&str> = log.lines().collect();
        let last = lines[lines.len().saturating_sub(20)..].join("\n");
        let text = format!("mluc up ended with {status}:\n{last}");
        if status.code() == Some(i32::from(EXIT_USAGE)) {
            return Err(UsageError(text).into());
        }
        bail!(text)
    }

    fn end(&mut self) {
        let pid = Pid::from_raw(self.process.id() as i32);
        let begun = Instant::now();
        if let (Ok(None), Some(pid)) = (self.process.try_wait(), pid) {
            let _ = kill_process(pid, Signal::TERM);
        }
        while matches!(self.process.try_wait(), Ok(None)) && begun.elapsed() < END_PATIENCE {
            std::thread::sleep(Duration::from_millis(5));
        }
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

impl Drop for Up {
    fn drop(&mut self) {
        self.end();
    }
}
