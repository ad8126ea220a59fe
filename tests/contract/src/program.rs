//! The program under test, and its process.

use std::io::Read;
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Context;
use mluc_ipc_types::RunDescription;
use mluc_runtime::{Instance, Shutdown};
use rustix::process::{Pid, Signal, kill_process_group};

/// Of what it wrote, this much is kept for the report, bytes.
const WORDS_MAX: usize = 4096;
/// How long its last words are waited for after its end.
const READER_PATIENCE: Duration = Duration::from_secs(2);

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
    status: Option<ExitStatus>,
    words: Arc<Mutex<Vec<u8>>>,
    /// Reads its stderr until nobody writes there any more.
    reader: Option<JoinHandle<()>>,
}

impl Program {
    /// In an instance, whose name in its environment is all that it needs.
    pub(crate) fn start(command: &[String], instance: &Instance) -> anyhow::Result<Program> {
        let (program, arguments) = command.split_first().context("no program given")?;
        let mut process = Command::new(program)
            .args(arguments)
            .env(Instance::VARIABLE, instance.name())
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .process_group(0)
            .spawn()
            .with_context(|| format!("starting {program}"))?;
        let words = Arc::new(Mutex::new(Vec::new()));
        let reader = process.stderr.take().map(|stderr| {
            let words = words.clone();
            std::thread::spawn(move || keep_last(stderr, &words))
        });
        Ok(Program {
            process,
            status: None,
            words,
            reader,
        })
    }

    /// How it ended, if it did.
    pub(crate) fn ended(&mut self) -> Option<ExitStatus> {
        if self.status.is_none() {
            self.status = self.process.try_wait().ok().flatten();
        }
        self.status
    }

    /// Waits for its end.
    pub(crate) fn end_within(&mut self, patience: Duration) -> Option<ExitStatus> {
        let begun = Instant::now();
        while self.ended().is_none() && begun.elapsed() < patience {
            std::thread::sleep(Duration::from_millis(5));
        }
        self.status
    }

    /// The end of what it wrote to stderr.
    pub(crate) fn last_words(&self) -> String {
        // The reader may be behind the process's end; a child that was left running may keep it for good.
        let patience = Instant::now() + READER_PATIENCE;
        let is_reading = || self.reader.as_ref().is_some_and(|r| !r.is_finished());
        while self.status.is_some() && is_reading() && Instant::now() < patience {
            std::thread::sleep(Duration::from_millis(5));
        }
        let words = self.words.lock().unwrap_or_else(PoisonError::into_inner);
        String::from_utf8_lossy(&words).trim().to_string()
    }

    pub(crate) fn signal(&self, signal: Signal) {
        if let Some(group) = Pid::from_raw(self.process.id() as i32) {
            // It may have ended already.
            let _ = kill_process_group(group, signal);
        }
    }

    /// By force, and waits until it is gone.
    pub(crate) fn kill(&mut self) {
        if self.status.is_none() {
            self.signal(Signal::KILL);
            self.status = self.process.wait().ok();
        }
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        self.kill();
    }
}

fn keep_last(mut from: impl Read, words: &Mutex<Vec<u8>>) {
    let mut bytes = [0; 1024];
    while let Ok(count @ 1..) = from.read(&mut bytes) {
        let mut words = words.lock().unwrap_or_else(PoisonError::into_inner);
        words.extend_from_slice(&bytes[..count]);
        let too_many = words.len().saturating_sub(WORDS_MAX);
        words.drain(..too_many);
    }
}
