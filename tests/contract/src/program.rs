//! The program under test, and its process.

use anyhow::{Context, bail, ensure};
use mluc_ipc_types::RunDescription;
use mluc_runtime::{Instance, Shutdown};
use rustix::process::{Pid, Signal, kill_process_group};
use serde_json::Value;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};
use std::{fs::File, os::unix::fs::FileExt, os::unix::process::CommandExt};

/// The report quotes at most this much of the program's stderr, bytes.
const WORDS_MAX: u64 = 4096;
/// Time to end after SIGTERM. The supervisor waits only 0.6 s and then kills; a loaded test machine is slow.
const END_PATIENCE: Duration = Duration::from_secs(3);

/// What a suite shall test, and how.
#[derive(Clone)]
pub(crate) struct Options {
    pub(crate) title: String,
    pub(crate) command: Vec<String>,
    /// The first run that the program sees.
    pub(crate) run: RunDescription,
    /// Limit for an answer or a start. A program that needs longer has failed.
    pub(crate) patience: Duration,
    pub(crate) shutdown: Shutdown,
}

/// A running program in its own process group: signals also reach processes that a shell in between started.
pub(crate) struct Program {
    process: Child,
    out: File,
    words: File,
}

impl Program {
    /// Starts the program in an instance. The instance's name in its environment is all that it needs.
    pub(crate) fn start(command: &[String], instance: &Instance) -> anyhow::Result<Program> {
        let (program, arguments) = command.split_first().context("no program given")?;
        let file = || tempfile::tempfile().context("a file for what it writes");
        let (out, words) = (file()?, file()?);
        let process = Command::new(program)
            .args(arguments)
            .env(Instance::VARIABLE, instance.name())
            .stdin(Stdio::null())
            .stdout(out.try_clone()?)
            .stderr(words.try_clone()?)
            .process_group(0)
            .spawn()
            .with_context(|| format!("starting {program}"))?;
        Ok(Program { process, out, words })
    }

    pub(crate) fn ended(&mut self) -> Option<ExitStatus> {
        self.process.try_wait().ok().flatten()
    }

    pub(crate) fn end_within(&mut self, patience: Duration) -> Option<ExitStatus> {
        let begun = Instant::now();
        while self.ended().is_none() && begun.elapsed() < patience {
            std::thread::sleep(Duration::from_millis(5));
        }
        self.ended()
    }

    /// The end of the program's stderr.
    pub(crate) fn last_words(&self) -> anyhow::Result<String> {
        let length = self.words.metadata()?.len();
        let mut words = vec![0; length.min(WORDS_MAX) as usize];
        // Reads without seeking: the program writes at the same position of the file.
        self.words.read_exact_at(&mut words, length.saturating_sub(WORDS_MAX))?;
        Ok(String::from_utf8_lossy(&words).trim().to_string())
    }

    /// The whole lines of the program's stdout.
    pub(crate) fn lines(&self) -> anyhow::Result<Vec<Value>> {
        let mut text = vec![0; self.out.metadata()?.len() as usize];
        self.out.read_exact_at(&mut text, 0)?;
        let end = text.iter().rposition(|byte| *byte == b'\n').map_or(0, |at| at + 1);
        let lines = text[..end].split_inclusive(|byte| *byte == b'\n');
        let line = |line: &[u8]| {
            let text = String::from_utf8_lossy(line);
            let about = || format!("its line is no JSON: {}", text.trim());
            serde_json::from_slice(line).with_context(about)
        };
        lines.map(line).collect()
    }

    pub(crate) fn signal(&self, signal: Signal) {
        if let Some(group) = Pid::from_raw(self.process.id() as i32) {
            // The process may already have ended.
            let _ = kill_process_group(group, signal);
        }
    }

    /// Kills the process and waits until it is gone.
    pub(crate) fn kill(&mut self) {
        if self.ended().is_none() {
            self.signal(Signal::KILL);
            let _ = self.process.wait();
        }
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        self.kill();
    }
}

/// A program in its own instance.
pub(crate) struct Tested {
    pub(crate) options: Options,
    pub(crate) instance: Instance,
    program: Option<Program>,
    /// Whether the program ever took part after a start.
    pub(crate) was_ready: bool,
}

impl Tested {
    pub(crate) fn new(options: Options) -> anyhow::Result<Tested> {
        Ok(Tested {
            options,
            instance: Instance::new(&format!("suite-{}", std::process::id()))?,
            program: None,
            was_ready: false,
        })
    }

    pub(crate) fn program(&mut self) -> anyhow::Result<&mut Program> {
        self.program.as_mut().context("the program does not run")
    }

    pub(crate) fn runs(&mut self) -> bool {
        let program = self.program.as_mut();
        program.is_some_and(|program| program.ended().is_none())
    }

    pub(crate) fn stop(&mut self) {
        self.program = None;
    }

    /// Starts the program in place of one that may be running.
    pub(crate) fn start(&mut self) -> anyhow::Result<()> {
        self.program = None;
        self.program = Some(Program::start(&self.options.command, &self.instance)?);
        Ok(())
    }

    /// Fails when this process was asked to end.
    pub(crate) fn check_uninterrupted(&self) -> anyhow::Result<()> {
        let is_asked = self.options.shutdown.is_requested();
        ensure!(!is_asked, "the suite was interrupted");
        Ok(())
    }

    pub(crate) fn check_alive(&mut self, awaited: &str) -> anyhow::Result<()> {
        self.check_uninterrupted()?;
        let program = self.program()?;
        if let Some(status) = program.ended() {
            let words = program.last_words()?;
            bail!("it ended ({status}), awaited: {awaited}; its last words: {words}");
        }
        Ok(())
    }

    /// What `look` finds within the patience while the program lives. `look` itself must pause.
    pub(crate) fn await_any<T>(
        &mut self,
        awaited: &str,
        mut look: impl FnMut(&mut Program) -> anyhow::Result<Option<T>>,
    ) -> anyhow::Result<T> {
        let begun = Instant::now();
        loop {
            if let Some(found) = look(self.program()?)? {
                return Ok(found);
            }
            self.check_alive(awaited)?;
            let patience = self.options.patience;
            ensure!(begun.elapsed() <= patience, "no {awaited} within {patience:?}");
        }
    }

    /// Asks the program to end; reports how long that took.
    pub(crate) fn terminate(&mut self) -> anyhow::Result<String> {
        let begun = Instant::now();
        self.program()?.signal(Signal::TERM);
        let ended = self.program()?.end_within(END_PATIENCE);
        let took_ms = begun.elapsed().as_millis();
        match ended {
            None => bail!("still running {END_PATIENCE:?} after SIGTERM"),
            Some(status) if !status.success() => bail!("{status} after SIGTERM"),
            Some(_) => Ok(format!("ended {took_ms} ms after SIGTERM")),
        }
    }
}
