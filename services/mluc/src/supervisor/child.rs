//! One stage's process: start, watch, restart. A process that is silent for too long is killed.

use super::predecessor::{MARK, mark};
use crate::settings::{RestartPolicy, Settings, StageSettings};
use crate::{EXIT_USAGE, UsageError, external::own_program};
use anyhow::{Context, Result, bail};
use mluc_ipc_types::Stage;
use mluc_runtime::{
    ClaimNote, HealthWatch, Instance, LOG_FORMAT_VARIABLE, MANAGER_VARIABLES, log_format,
    monotonic_ns,
};
use rustix::process::{Pid, Signal, kill_process_group, test_kill_process_group};
use smart_default::SmartDefault;
use std::process::{Child as Process, ExitStatus, Stdio};
use std::time::{Duration, Instant};
use std::{collections::VecDeque, os::unix::process::CommandExt, os::unix::process::ExitStatusExt};

/// First delay of a restart if no frame was published since the last restart; each further delay is twice as long.
const DELAY_FIRST: Duration = Duration::from_millis(50);
const DELAY_MAX: Duration = Duration::from_secs(5);
/// A stage that dies by itself more often than this within [`CRASH_LOOP_TIME`] is reported as a crash loop. A guess.
const CRASH_LOOP_DEATHS: usize = 5;
const CRASH_LOOP_TIME: Duration = Duration::from_secs(600);
/// How long the processes that a stage had started may take to end after a kill.
const GROUP_PATIENCE: Duration = Duration::from_secs(2);

/// Whether the process has ended, and how.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ended {
    No,
    /// It ended with exit code 0.
    Done,
    /// It was ended by a signal from outside, or stopped and then killed by the watchdog.
    Hit,
    /// It ended in any other way. The field is the frame that it was working on, if one is known.
    Died(Option<u64>),
}

#[derive(SmartDefault)]
pub(super) struct Child {
    #[default(Stage::Ingest)]
    pub(super) stage: Stage,
    process: Option<Process>,
    started_ns: u64,
    due: Option<Instant>,
    #[default(DELAY_FIRST)]
    delay: Duration,
    was_ready: bool,
    /// Whether it has published a frame since its start.
    has_published: bool,
    /// Frames that its heartbeats already include at its start.
    frames_before: u64,
    /// The time of its longest frame since its start, us.
    run_max_us: u32,
    /// Process id in the heartbeats of the process before it, whose last heartbeat may come late.
    pid_before: u32,
    /// Process group of the process before it: programs that it had started may still run.
    group_before: Option<Pid>,
    /// The watchdog has killed it, and it is not gone yet.
    is_killed: bool,
    /// A signal from outside had stopped it when the watchdog killed it.
    was_stopped: bool,
    /// The machine's count of out-of-memory kills when it was started.
    oom_kills_before: u64,
    /// Number of deaths by itself in a row, without a frame between them.
    failures: u32,
    /// Times when it died by itself, at most one more than [`CRASH_LOOP_DEATHS`].
    deaths: VecDeque<Instant>,
    is_crash_loop: bool,
    is_foreign: bool,
    /// A silent process that somebody else started is reported once in each silence.
    is_silence_reported: bool,
}

impl Child {
    pub(super) fn new(stage: Stage) -> Child {
        Child { stage, ..Child::default() }
    }

    /// Process id; 0 when it does not run.
    pub(super) fn pid(&self) -> u32 {
        self.process.as_ref().map_or(0, Process::id)
    }

    /// Signals the process and all that it started: a script's program, for instance.
    pub(super) fn signal(&self, signal: Signal) {
        if let Some(group) = Pid::from_raw(self.pid() as i32) {
            // It may have ended already.
            let _ = kill_process_group(group, signal);
        }
    }

    pub(super) fn start(&mut self, settings: &Settings, start_sequence: u64) -> Result<()> {
        let own = &settings.stages[self.stage];
        (self.was_ready, self.has_published) = (false, false);
        let supervisor = std::process::id().to_string();
        let mut command = own.placed(own_program());
        match &own.command {
            // Our own program starts first, ties itself to the supervisor, and then replaces itself with the other one.
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
                // With this setting glibc returns the memory of a replaced model to the system.
                command.env("MALLOC_MMAP_THRESHOLD_", "131072");
            }
        }
        command
            .env(Instance::VARIABLE, settings.instance.name())
            .env(LOG_FORMAT_VARIABLE, log_format())
            .env(MARK, mark(&settings.instance))
            .stdin(Stdio::null())
            // stdout is only for the JSON lines.
            .stdout(std::io::stderr())
            // Ctrl-C reaches only the supervisor, which ends the stages.
            .process_group(0);
        for variable in MANAGER_VARIABLES {
            command.env_remove(variable);
        }
        let folder = own.directory.as_ref();
        let folder = folder.map_or(String::new(), |folder| format!(" in {}", folder.display()));
        let about = || format!("starting stage {}{folder}", self.stage.name());
        let process = command.spawn().with_context(about)?;
        self.process = Some(process);
        self.oom_kills_before = oom_kills();
        self.started_ns = monotonic_ns();
        self.due = None;
        (self.is_killed, self.was_stopped) = (false, false);
        self.is_foreign = own.command.is_some();
        self.run_max_us = 0;
        // A restarted ingest also counts the frames of the one before it.
        let counts_on = self.stage == Stage::Ingest && !self.is_foreign;
        self.frames_before = if counts_on { start_sequence } else { 0 };
        Ok(())
    }

    /// Starts the process again. A start that fails counts as a death by itself, and the next restart is planned.
    pub(super) fn restart(&mut self, settings: &Settings, start_sequence: u64) -> Result<()> {
        if let Err(error) = self.start(settings, start_sequence) {
            tracing::error!(stage = self.stage.name(), "{error:#}");
            self.judge(None, settings)?;
            self.plan_restart();
        }
        Ok(())
    }

    /// Whether it ended; kills it when it has been silent for longer than its settings allow. `regular_since_ns`: the supervisor
    /// has checked without a pause since then. Silence before that does not count, because the whole machine may have paused.
    pub(super) fn watch(
        &mut self,
        health: &HealthWatch,
        settings: &Settings,
        regular_since_ns: u64,
    ) -> Result<Ended> {
        let own = &settings.stages[self.stage];
        if own.external {
            self.report_silence(health, own, regular_since_ns);
            let is_done = self.stage == Stage::Ingest && health.has_finished(self.stage);
            return Ok(if is_done { Ended::Done } else { Ended::No });
        }
        let heard_ns = health.heard_ns(self.stage);
        let heartbeat = health.of(self.stage).filter(|health| {
            let is_own = health.pid == self.pid();
            let is_new = self.is_foreign && health.pid != self.pid_before;
            (is_own || is_new) && heard_ns > self.started_ns
        });
        if let Some(heartbeat) = heartbeat {
            self.was_ready |= health.is_ready(self.stage);
            self.has_published |= heartbeat.frames_out > self.frames_before;
            self.run_max_us = self.run_max_us.max(heartbeat.run_max_us);
            self.failures *= u32::from(!self.has_published);
        }
        let group = Pid::from_raw(self.pid() as i32);
        let pid = self.pid();
        let Some(process) = &mut self.process else {
            return Ok(Ended::No);
        };
        if let Some(status) = process.try_wait().context("watching a stage")? {
            // Processes that it started may still run and keep the stage's role.
            self.signal(Signal::KILL);
            self.process = None;
            self.pid_before = heartbeat.map_or(0, |health| health.pid);
            let ended = self.ended(status, pid, settings);
            self.group_before = group;
            return ended;
        }
        // Its first frame may take long, but a stage that waits for its first frame must send heartbeats.
        let is_idle = || {
            let note = ClaimNote::read(&settings.instance, self.stage.name());
            note.is_some_and(|note| note.pid == pid && note.sequence.is_none())
        };
        let (limit_ms, key) = if self.has_published || (self.was_ready && is_idle()) {
            let limit_ms = heartbeat_limit_ms(own, self.run_max_us);
            (limit_ms, "heartbeat_max_ms")
        } else {
            (own.start_max_ms, "start_max_ms")
        };
        let heard_ns = heard_ns * u64::from(self.was_ready || self.has_published);
        let since_ns = self.started_ns.max(heard_ns).max(regular_since_ns);
        let silent_ms = monotonic_ns().saturating_sub(since_ns) / 1_000_000;
        if limit_ms > 0 && silent_ms > limit_ms && !self.is_killed {
            self.is_killed = true;
            self.was_stopped = is_stopped(self.pid());
            self.signal(Signal::KILL);
            let name = self.stage.name();
            let stopped = "is stopped by a signal";
            let what = if self.was_stopped { stopped } else { "hangs" };
            tracing::error!(
                stage = name,
                "{what}: {silent_ms} ms without a sign of life, {limit_ms} allowed ({key} of [stages.{name}]): killed"
            );
        }
        Ok(Ended::No)
    }

    fn ended(&mut self, status: ExitStatus, pid: u32, settings: &Settings) -> Result<Ended> {
        if status.success() {
            // Ingest ends so at the end of its input. Our other stages end so only if somebody outside asks them to.
            if self.stage != Stage::Ingest && self.is_foreign {
                tracing::error!(stage = self.stage.name(), "ended by itself: {status}");
                self.judge(status.code(), settings)?;
            }
            return Ok(Ended::Done);
        }
        tracing::error!(stage = self.stage.name(), "ended: {status}");
        let is_by = |signal: Signal| status.signal() == Some(signal.as_raw());
        let is_killed = is_by(Signal::KILL) && (!self.is_killed || self.was_stopped);
        // The supervisor asks no stage to end before the run ends, so SIGTERM came from outside.
        let is_hit = is_killed || is_by(Signal::TERM);
        // A kill for lack of memory is no accident: the next process will need as much.
        let is_oom = is_killed && oom_kills() > self.oom_kills_before;
        if is_oom {
            tracing::error!(
                stage = self.stage.name(),
                "the kernel killed the stage for lack of memory (oom_kill of /proc/vmstat)"
            );
        } else if is_hit {
            return Ok(Ended::Hit);
        }
        self.judge(status.code(), settings)?;
        let note = ClaimNote::read(&settings.instance, self.stage.name());
        let note = note.filter(|note| note.pid == pid);
        Ok(Ended::Died(note.and_then(|note| note.sequence)))
    }

    /// Reports silence of a process that somebody else started; such a process is never signalled.
    fn report_silence(&mut self, health: &HealthWatch, own: &StageSettings, regular_since_ns: u64) {
        let Some(heartbeat) = health.of(self.stage) else {
            return;
        };
        self.run_max_us = self.run_max_us.max(heartbeat.run_max_us);
        let limit_ms = match heartbeat.frames_out {
            0 => own.start_max_ms,
            _ => heartbeat_limit_ms(own, self.run_max_us),
        };
        let since_ns = health.heard_ns(self.stage).max(regular_since_ns);
        let silent_ns = monotonic_ns().saturating_sub(since_ns);
        let is_silent = limit_ms > 0 && silent_ns / 1_000_000 > limit_ms;
        let (stage, pid) = (self.stage.name(), heartbeat.pid);
        match (is_silent, self.is_silence_reported) {
            (true, false) => {
                tracing::error!(stage, pid, "no heartbeat for {limit_ms} ms: it hangs or has ended")
            }
            (false, true) => tracing::info!(stage, pid, "heartbeats again"),
            _ => (),
        }
        self.is_silence_reported = is_silent;
    }

    /// Judges a death by itself: deaths that repeat without a frame between them are no accident.
    fn judge(&mut self, code: Option<i32>, settings: &Settings) -> Result<()> {
        let name = self.stage.name();
        self.count_death();
        // Settings that a process before it took are no mistake of the user's: an update may have replaced a program.
        let is_first = self.group_before.is_none();
        if code == Some(i32::from(EXIT_USAGE)) && !self.is_foreign && is_first {
            let text = format!("stage {name} refuses its settings (see above)");
            return Err(UsageError(text).into());
        }
        self.failures += 1;
        let limit = settings.restart_limit;
        if self.failures < limit {
            return Ok(());
        }
        let what = format!("died {limit} times in a row without a frame (restart_limit)");
        match settings.on_restart_limit {
            RestartPolicy::End => bail!("stage {name} {what}: see above"),
            RestartPolicy::Degraded if self.failures == limit => {
                tracing::error!(stage = name, "{what}: the others run on without it");
            }
            RestartPolicy::Degraded => (),
        }
        self.delay = DELAY_MAX;
        Ok(())
    }

    /// Whether the other stages run on without it.
    pub(super) fn is_given_up(&self, settings: &Settings) -> bool {
        self.failures >= settings.restart_limit
    }

    /// Counts a death, and reports a crash loop.
    fn count_death(&mut self) {
        self.deaths.push_back(Instant::now());
        if self.deaths.len() > CRASH_LOOP_DEATHS + 1 {
            self.deaths.pop_front();
        }
        let seconds = self.deaths[0].elapsed().as_secs_f64();
        self.is_crash_loop =
            self.deaths.len() > CRASH_LOOP_DEATHS && seconds < CRASH_LOOP_TIME.as_secs_f64();
        if self.is_crash_loop {
            let (stage, count) = (self.stage.name(), self.deaths.len());
            tracing::error!(stage, "crash loop: died by itself {count} times in {seconds:.0} s");
        }
    }

    /// Plans a restart: at once if it has published a frame; otherwise, and in a crash loop, after a growing delay.
    pub(super) fn plan_restart(&mut self) {
        let is_recent = |death: &Instant| death.elapsed() < CRASH_LOOP_TIME;
        self.is_crash_loop &= self.deaths.front().is_some_and(is_recent);
        let at_once = self.has_published && !self.is_crash_loop;
        let delay = self.delay * u32::from(!at_once);
        tracing::warn!(stage = self.stage.name(), "restart in {delay:?}");
        self.due = Some(Instant::now() + delay);
        self.delay = (delay * 2).clamp(DELAY_FIRST, DELAY_MAX);
    }

    /// Whether a planned restart is due, and the processes that the process before it had started are gone.
    pub(super) fn is_due(&self) -> bool {
        self.due.is_some_and(|due| {
            let late = Instant::now().saturating_duration_since(due);
            due <= Instant::now() && (late > GROUP_PATIENCE || !is_alive(self.group_before))
        })
    }

    /// Whether it, or a process that it started, is running.
    pub(super) fn is_running(&mut self) -> bool {
        let group = Pid::from_raw(self.pid() as i32);
        let process = self.process.as_mut();
        process.is_some_and(|process| !matches!(process.try_wait(), Ok(Some(_))) || is_alive(group))
    }

    /// Kills it, and waits until it is gone.
    pub(super) fn kill(&mut self) {
        self.signal(Signal::KILL);
        let group = Pid::from_raw(self.pid() as i32);
        let Some(mut process) = self.process.take() else {
            return;
        };
        let _ = process.wait();
        let begun = Instant::now();
        while is_alive(group) && begun.elapsed() < GROUP_PATIENCE {
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

fn is_alive(group: Option<Pid>) -> bool {
    group.is_some_and(|group| test_kill_process_group(group).is_ok())
}

/// How many processes the kernel has killed for lack of memory, of the machine or of a cgroup.
fn oom_kills() -> u64 {
    let counts = std::fs::read_to_string("/proc/vmstat").unwrap_or_default();
    counts.lines().find_map(|line| line.strip_prefix("oom_kill ")?.parse().ok()).unwrap_or(0)
}

/// Whether a signal has stopped the process (state T of the kernel).
fn is_stopped(pid: u32) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    let rest = stat.rsplit(')').next();
    rest.is_some_and(|rest| rest.trim_start().starts_with(['T', 't']))
}

/// The longest silence that is allowed. A frame may take twice as long as the longest one so far, so a slow network is no hang. 0: no limit.
fn heartbeat_limit_ms(own: &StageSettings, run_max_us: u32) -> u64 {
    let twice_ms = u64::from(run_max_us) / 500;
    own.heartbeat_max_ms.max(twice_ms) * u64::from(own.heartbeat_max_ms > 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slow_network_is_no_hang() {
        let own = StageSettings::default();
        let limits = [0, 3_000_000].map(|run_max_us| heartbeat_limit_ms(&own, run_max_us));
        assert_eq!(limits, [own.heartbeat_max_ms, 6000]);
    }

    #[test]
    fn only_the_first_process_of_a_stage_refuses_its_settings() {
        let (settings, mut child) = (Settings::default(), Child::new(Stage::Ingest));
        let refused = Some(i32::from(EXIT_USAGE));
        assert!(child.judge(refused, &settings).is_err());
        child.group_before = Pid::from_raw(1);
        assert!(child.judge(refused, &settings).is_ok());
        assert_eq!(child.failures, 1);
    }
}
