//! One stage's process: start, watch, restart. One that says nothing for too long is killed.

use std::collections::VecDeque;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child as Process, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use mluc_ipc_types::Stage;
use mluc_runtime::{HealthWatch, Instance, monotonic_ns};
use rustix::process::{Pid, Signal, kill_process_group};

use crate::EXIT_USAGE;
use crate::settings::{Settings, StageSettings};

/// Delay of a restart where no frame was published since the last one; each further one is twice as long.
const DELAY_FIRST: Duration = Duration::from_millis(50);
const DELAY_MAX: Duration = Duration::from_secs(5);
/// A stage that dies by itself more often than this within [`CRASH_LOOP_TIME`] is reported as a crash loop. A guess.
const CRASH_LOOP_DEATHS: usize = 5;
const CRASH_LOOP_TIME: Duration = Duration::from_secs(600);
/// Starts that fail in a row, with an error and before the stage was ready, until the run is given up.
const FAILED_STARTS_MAX: u32 = 3;

/// What a look at the process found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ended {
    No,
    /// With exit code 0.
    Done,
    /// In any other way.
    Died,
}

pub(super) struct Child {
    pub(super) stage: Stage,
    process: Option<Process>,
    started_ns: u64,
    due: Option<Instant>,
    delay: Duration,
    was_ready: bool,
    /// A frame since its start.
    has_published: bool,
    /// By the watchdog, and not gone yet.
    is_killed: bool,
    failed_starts: u32,
    /// When it died by itself, at most one more than [`CRASH_LOOP_DEATHS`].
    deaths: VecDeque<Instant>,
    is_foreign: bool,
    /// One that somebody else started is reported once in each silence.
    is_silence_reported: bool,
}

impl Child {
    pub(super) fn new(stage: Stage) -> Child {
        Child {
            stage,
            process: None,
            started_ns: 0,
            due: None,
            delay: DELAY_FIRST,
            was_ready: false,
            has_published: false,
            is_killed: false,
            failed_starts: 0,
            deaths: VecDeque::new(),
            is_foreign: false,
            is_silence_reported: false,
        }
    }

    /// 0 when it does not run.
    pub(super) fn pid(&self) -> u32 {
        self.process.as_ref().map_or(0, Process::id)
    }

    /// The process and all that it started: a script's program, for instance.
    fn signal(&self, signal: Signal) {
        if let Some(group) = Pid::from_raw(self.pid() as i32) {
            // It may have ended already.
            let _ = kill_process_group(group, signal);
        }
    }

    pub(super) fn start(&mut self, settings: &Settings, start_sequence: u64) -> anyhow::Result<()> {
        let own = &settings.stages[self.stage];
        let supervisor = std::process::id().to_string();
        let mut command =
            own.placed(std::env::current_exe().context("finding this program's file")?);
        match &own.command {
            // Our own program first, which ties itself to us and then becomes the other one.
            Some(program) => {
                command.args(["exec", "--supervised-by", &supervisor]);
                command.args(own.cpus_argument());
                command.arg("--").args(program);
                if let Some(directory) = &own.directory {
                    command.current_dir(directory);
                }
            }
            None => {
                command.args(["stage", self.stage.name()]);
                command.args(["--instance", settings.instance.name()]);
                command.args(["--supervised-by", &supervisor]);
                command.args(["--start-sequence", &start_sequence.to_string()]);
            }
        }
        command
            .env(Instance::VARIABLE, settings.instance.name())
            .stdin(Stdio::null())
            // stdout holds the JSON lines, and nothing else.
            .stdout(std::io::stderr())
            // Ctrl-C reaches us alone; we end the stages.
            .process_group(0);
        let process = command
            .spawn()
            .with_context(|| format!("starting stage {}", self.stage.name()))?;
        self.process = Some(process);
        self.started_ns = monotonic_ns();
        self.due = None;
        (self.was_ready, self.has_published, self.is_killed) = (false, false, false);
        self.is_foreign = own.command.is_some();
        Ok(())
    }

    /// Whether it ended; kills it when it has said nothing for longer than its settings allow.
    pub(super) fn watch(
        &mut self,
        health: &HealthWatch,
        own: &StageSettings,
    ) -> anyhow::Result<Ended> {
        if own.external {
            self.report_silence(health, own);
            return Ok(Ended::No);
        }
        let heartbeat = health
            .of(self.stage)
            .filter(|health| self.is_foreign || health.pid == self.pid());
        let heard_ns = health.heard_ns(self.stage);
        let heartbeat = heartbeat.filter(|_| heard_ns > self.started_ns);
        self.was_ready |= heartbeat.is_some() && health.is_ready(self.stage);
        self.has_published |= heartbeat.is_some_and(|health| health.frames_out > 0);
        let Some(process) = &mut self.process else {
            return Ok(Ended::No);
        };
        if let Some(status) = process.try_wait().context("watching a stage")? {
            // What it started may still run and hold the stage's place.
            self.signal(Signal::KILL);
            self.process = None;
            if status.success() {
                return Ok(Ended::Done);
            }
            self.judge(status)?;
            return Ok(Ended::Died);
        }
        let run_max_us = heartbeat.map_or(0, |health| health.run_max_us);
        let since_ns = self.started_ns.max(heard_ns * u64::from(self.was_ready));
        let (limit_ms, key) = if self.has_published {
            (heartbeat_limit_ms(own, run_max_us), "heartbeat_max_ms")
        } else {
            (own.start_max_ms, "start_max_ms")
        };
        let silent_ms = monotonic_ns().saturating_sub(since_ns) / 1_000_000;
        if limit_ms > 0 && silent_ms > limit_ms && !self.is_killed {
            let name = self.stage.name();
            tracing::error!(
                stage = name,
                "hangs: {silent_ms} ms without a sign of life, {limit_ms} allowed ({key} of [stages.{name}]): killed"
            );
            self.is_killed = true;
            self.signal(Signal::KILL);
        }
        Ok(Ended::No)
    }

    /// A process of somebody else is never signalled.
    fn report_silence(&mut self, health: &HealthWatch, own: &StageSettings) {
        let Some(heartbeat) = health.of(self.stage) else {
            return;
        };
        let limit_ms = heartbeat_limit_ms(own, heartbeat.run_max_us);
        let silent_ns = monotonic_ns().saturating_sub(health.heard_ns(self.stage));
        let is_silent = limit_ms > 0 && silent_ns / 1_000_000 > limit_ms;
        let (stage, pid) = (self.stage.name(), heartbeat.pid);
        match (is_silent, self.is_silence_reported) {
            (true, false) => tracing::error!(
                stage,
                pid,
                "no heartbeat for {limit_ms} ms: it hangs or has ended"
            ),
            (false, true) => tracing::info!(stage, pid, "heartbeats again"),
            _ => (),
        }
        self.is_silence_reported = is_silent;
    }

    /// An error at the start that repeats is no accident.
    fn judge(&mut self, status: ExitStatus) -> anyhow::Result<()> {
        let name = self.stage.name();
        tracing::error!(stage = name, "ended: {status}");
        self.count_death(&status);
        let failed_to_start = status.code().is_some() && !self.was_ready;
        self.failed_starts = u32::from(failed_to_start) * (self.failed_starts + 1);
        if status.code() == Some(i32::from(EXIT_USAGE)) && !self.is_foreign {
            bail!("stage {name} refuses its settings (see above)");
        }
        if self.failed_starts >= FAILED_STARTS_MAX {
            bail!("stage {name} failed to start {FAILED_STARTS_MAX} times (see above)");
        }
        Ok(())
    }

    /// Says so when it dies again and again. A kill comes from outside and does not count.
    fn count_death(&mut self, status: &ExitStatus) {
        if status.signal() == Some(Signal::KILL.as_raw()) {
            return;
        }
        self.deaths.push_back(Instant::now());
        if self.deaths.len() > CRASH_LOOP_DEATHS + 1 {
            self.deaths.pop_front();
        }
        let is_loop =
            self.deaths.len() > CRASH_LOOP_DEATHS && self.deaths[0].elapsed() < CRASH_LOOP_TIME;
        if is_loop {
            tracing::error!(
                stage = self.stage.name(),
                "crash loop: died by itself {} times in {:.0} s",
                self.deaths.len(),
                self.deaths[0].elapsed().as_secs_f64()
            );
        }
    }

    /// At once where it has published a frame, else after a growing delay.
    pub(super) fn plan_restart(&mut self) {
        let delay = if self.has_published {
            Duration::ZERO
        } else {
            self.delay
        };
        tracing::warn!(stage = self.stage.name(), "restart in {delay:?}");
        self.due = Some(Instant::now() + delay);
        self.delay = (delay * 2).clamp(DELAY_FIRST, DELAY_MAX);
    }

    /// Whether a planned restart's time has come.
    pub(super) fn is_due(&self) -> bool {
        self.due.is_some_and(|due| due <= Instant::now())
    }

    pub(super) fn ask_to_end(&mut self) {
        self.signal(Signal::TERM);
    }

    pub(super) fn is_running(&mut self) -> bool {
        let process = self.process.as_mut();
        process.is_some_and(|process| !matches!(process.try_wait(), Ok(Some(_))))
    }

    /// By force, and waits until it is gone.
    pub(super) fn kill(&mut self) {
        self.signal(Signal::KILL);
        if let Some(mut process) = self.process.take() {
            let _ = process.wait();
        }
    }
}

/// A frame may take twice as long as the longest one so far: a slow network is no hang. 0: no limit.
fn heartbeat_limit_ms(own: &StageSettings, run_max_us: u32) -> u64 {
    let twice_ms = u64::from(run_max_us) / 500;
    own.heartbeat_max_ms.max(twice_ms) * u64::from(own.heartbeat_max_ms > 0)
}
