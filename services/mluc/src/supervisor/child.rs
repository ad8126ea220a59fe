//! One stage's process: start, watch, restart with a growing delay.

use std::process::{Child as Process, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use mluc_ipc_types::Stage;
use mluc_runtime::Instance;
use rustix::process::{Pid, Signal, kill_process};

use crate::EXIT_USAGE;
use crate::settings::Settings;

/// First delay; each further one is twice as long.
const DELAY_FIRST: Duration = Duration::from_millis(50);
const DELAY_MAX: Duration = Duration::from_secs(5);
/// A stage that lived so long begins with the first delay again.
const LIFE_GOOD: Duration = Duration::from_secs(10);
/// A stage that is not ready after this long hangs (cleaning after a killed process, for instance): killed and restarted.
/// A guess with room for a large model on a loaded machine.
const READY_PATIENCE: Duration = Duration::from_secs(30);
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
    started: Instant,
    due: Option<Instant>,
    delay: Duration,
    was_ready: bool,
    failed_starts: u32,
    is_foreign: bool,
}

impl Child {
    pub(super) fn new(stage: Stage) -> Child {
        Child {
            stage,
            process: None,
            started: Instant::now(),
            due: None,
            delay: DELAY_FIRST,
            was_ready: false,
            failed_starts: 0,
            is_foreign: false,
        }
    }

    /// 0 when it does not run.
    pub(super) fn pid(&self) -> u32 {
        self.process.as_ref().map_or(0, Process::id)
    }

    pub(super) fn start(&mut self, settings: &Settings, start_sequence: u64) -> anyhow::Result<()> {
        use std::os::unix::process::CommandExt;
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
        self.started = Instant::now();
        self.due = None;
        self.was_ready = false;
        self.is_foreign = own.command.is_some();
        Ok(())
    }

    /// Whether it ended; kills it when it hangs in its start.
    pub(super) fn watch(&mut self, is_ready: bool) -> anyhow::Result<Ended> {
        self.was_ready |= is_ready;
        let Some(process) = &mut self.process else {
            return Ok(Ended::No);
        };
        let status = process.try_wait().context("watching a stage")?;
        let Some(status) = status else {
            let is_starting = !self.was_ready && !self.is_foreign;
            if is_starting && self.started.elapsed() > READY_PATIENCE {
                let stage = self.stage.name();
                tracing::error!(stage, "not ready after {READY_PATIENCE:?}: killed");
                process.kill().context("killing a stage that hangs")?;
            }
            return Ok(Ended::No);
        };
        self.process = None;
        if status.success() {
            return Ok(Ended::Done);
        }
        self.judge(status)?;
        Ok(Ended::Died)
    }

    /// An error at the start that repeats is no accident.
    fn judge(&mut self, status: ExitStatus) -> anyhow::Result<()> {
        let name = self.stage.name();
        tracing::error!(stage = name, "ended: {status}");
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

    pub(super) fn plan_restart(&mut self) {
        if self.started.elapsed() > LIFE_GOOD {
            self.delay = DELAY_FIRST;
        }
        tracing::warn!(stage = self.stage.name(), "restart in {:?}", self.delay);
        self.due = Some(Instant::now() + self.delay);
        self.delay = (self.delay * 2).min(DELAY_MAX);
    }

    /// Whether a planned restart's time has come.
    pub(super) fn is_due(&self) -> bool {
        self.due.is_some_and(|due| due <= Instant::now())
    }

    pub(super) fn ask_to_end(&mut self) {
        if let Some(pid) = Pid::from_raw(self.pid() as i32) {
            // It may have ended already.
            let _ = kill_process(pid, Signal::TERM);
        }
    }

    pub(super) fn is_running(&mut self) -> bool {
        let process = self.process.as_mut();
        process.is_some_and(|process| !matches!(process.try_wait(), Ok(Some(_))))
    }

    /// By force, and waits until it is gone.
    pub(super) fn kill(&mut self) {
        if let Some(mut process) = self.process.take() {
            let _ = process.kill();
            let _ = process.wait();
        }
    }
}
