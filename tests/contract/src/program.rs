//! The program under test, and its process.

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use anyhow::Context;
use mluc_ipc_types::RunDescription;
use mluc_runtime::{Instance, Shutdown};
use rustix::process::{Pid, Signal, kill_process_group};

/// Of what it wrote, this much goes into the report, bytes.
const WORDS_MAX: u64 = 4096;

/// What a suite shall test, and how.
pub(crate) struct Options {
    /// For the report.
    pub(crate) title: String,
    /// Program and arguments.
    pub(crate) command: Vec<String>,
    /// The first run that it sees.
    pub(crate) run: RunDescription,
    /// How long an answer, or a start, may take. A program that needs longer failed.
    pub(crate) patience: Duration,
    /// Ends the suite early.
    pub(crate) shutdown: Shutdown,
}

/// A running program, in a process group of its own: signals reach what a shell in between started, too.
pub(crate) struct Program {
    process: Child,
    /// Its stderr.
    words: File,
}

impl Program {
    /// In an instance, whose name in its environment is all that it needs.
    pub(crate) fn start(command: &[String], instance: &Instance) -> anyhow::Result<Program> {
        let (program, arguments) = command.split_first().context("no program given")?;
        let words = tempfile::tempfile().context("a file for what it writes")?;
        let process = Command::new(program)
            .args(arguments)
            .env(Instance::VARIABLE, instance.name())
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(words.try_clone()?)
            .process_group(0)
            .spawn()
            .with_context(|| format!("starting {program}"))?;
        Ok(Program { process, words })
    }

    /// How it ended, if it did.
    pub(crate) fn ended(&mut self) -> Option<ExitStatus> {
        self.process.try_wait().ok().flatten()
    }

    /// Waits for its end.
    pub(crate) fn end_within(&mut self, patience: Duration) -> Option<ExitStatus> {
        let begun = Instant::now();
        while self.ended().is_none() && begun.elapsed() < patience {
            std::thread::sleep(Duration::from_millis(5));
        }
        self.ended()
    }

    /// The end of what it wrote to stderr.
    pub(crate) fn last_words(&self) -> anyhow::Result<String> {
        let length = self.words.metadata()?.len();
        let mut words = vec![0; length.min(WORDS_MAX) as usize];
        // Not by seeking: the program writes at the same position of the file.
        self.words
            .read_exact_at(&mut words, length.saturating_sub(WORDS_MAX))?;
        Ok(String::from_utf8_lossy(&words).trim().to_string())
    }

    pub(crate) fn signal(&self, signal: Signal) {
        if let Some(group) = Pid::from_raw(self.process.id() as i32) {
            // It may have ended already.
            let _ = kill_process_group(group, signal);
        }
    }

    /// By force, and waits until it is gone.
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
