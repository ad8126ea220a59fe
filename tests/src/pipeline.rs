//! Running `mluc` as a process.

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

/// A program beside the tests that cargo built: `target/release/deps/test-1234` has it in `target/release`.
pub fn built_program(name: &str) -> PathBuf {
    let test = std::env::current_exe().expect("a running test");
    let folder = test.ancestors().nth(2).expect("target/PROFILE");
    let program = folder.join(name);
    assert!(
        program.exists(),
        "{} is missing: run `cargo test --workspace`, or build it with the same profile first (`cargo build -p mluc -p \
         mluc-contract --bins --examples`)",
        program.display()
    );
    program
}

/// The program `mluc`.
pub fn mluc_program() -> PathBuf {
    built_program("mluc")
}

/// A name that no other test uses.
pub fn unique_instance(label: &str) -> String {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    format!(
        "{label}-{}-{}",
        std::process::id(),
        COUNT.fetch_add(1, Ordering::Relaxed)
    )
}

/// Files of an instance in shared memory.
pub fn leftovers(instance: &str) -> Vec<String> {
    let stem = format!("mluc-{}-{instance}", rustix::process::geteuid().as_raw());
    let entries = std::fs::read_dir("/dev/shm")
        .expect("shared memory")
        .flatten();
    entries
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .filter(|name| *name == stem || name.starts_with(&format!("{stem}.")))
        .collect()
}

/// How a run ended.
#[derive(Debug)]
pub struct Finished {
    /// Exit code; `None`: by a signal.
    pub code: Option<i32>,
    /// stdout, a value a line.
    pub lines: Vec<Value>,
    /// stderr.
    pub log: String,
}

impl Finished {
    /// The frames' names in the order of the lines.
    pub fn frames(&self) -> Vec<&str> {
        self.lines
            .iter()
            .map(|line| line["frame"].as_str().unwrap_or("?"))
            .collect()
    }

    /// stdout where it is text.
    pub fn text(&self) -> String {
        let lines: Vec<&str> = self.lines.iter().filter_map(Value::as_str).collect();
        lines.join("\n")
    }

    /// The flags of a frame.
    pub fn flags(&self, frame: &str) -> Vec<&str> {
        let line = self.lines.iter().find(|line| line["frame"] == frame);
        let flags = line.unwrap_or_else(|| panic!("no line of frame {frame}: {}", self.log));
        flags["flags"]
            .as_array()
            .into_iter()
            .flatten()
            .filter_map(Value::as_str)
            .collect()
    }
}

/// A running `mluc`; ended when dropped.
pub struct Pipeline {
    process: Child,
    lines: Arc<Mutex<Vec<Value>>>,
    log: Arc<Mutex<String>>,
    readers: Vec<JoinHandle<()>>,
}

impl Pipeline {
    /// Starts `mluc ARGUMENTS`.
    pub fn start<S: AsRef<std::ffi::OsStr>>(arguments: impl IntoIterator<Item = S>) -> Pipeline {
        let mut process = Command::new(mluc_program())
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("mluc starts");
        let (lines, log) = (
            Arc::new(Mutex::new(Vec::new())),
            Arc::new(Mutex::new(String::new())),
        );
        let (stdout, stderr) = (process.stdout.take(), process.stderr.take());
        let (own_lines, own_log) = (lines.clone(), log.clone());
        let readers = vec![
            std::thread::spawn(move || {
                for line in BufReader::new(stdout.expect("piped"))
                    .lines()
                    .map_while(Result::ok)
                {
                    let value = serde_json::from_str(&line).unwrap_or(Value::String(line));
                    own_lines.lock().expect("no panic").push(value);
                }
            }),
            std::thread::spawn(move || {
                let mut reader = BufReader::new(stderr.expect("piped"));
                let mut bytes = [0; 4096];
                while let Ok(count @ 1..) = reader.read(&mut bytes) {
                    let text = String::from_utf8_lossy(&bytes[..count]);
                    own_log.lock().expect("no panic").push_str(&text);
                }
            }),
        ];
        Pipeline {
            process,
            lines,
            log,
            readers,
        }
    }

    /// `mluc up` on `input`, the usual way of the tests.
    pub fn up(instance: &str, model: &Path, input: &Path, more: &[&str]) -> Pipeline {
        let paths = [model, input].map(|path| path.display().to_string());
        let mut arguments = vec![
            "up",
            "--instance",
            instance,
            "--model",
            &paths[0],
            "--input",
            &paths[1],
        ];
        arguments.extend(more);
        Pipeline::start(arguments)
    }

    /// Of `mluc` itself.
    pub fn pid(&self) -> u32 {
        self.process.id()
    }

    /// Processes of its stages: `(stage, process)`.
    pub fn stages(&self) -> Vec<(String, u32)> {
        // `mluc bench` starts a `mluc up`, whose children are the stages.
        let children = children(self.pid());
        let grandchildren = children.iter().copied().flat_map(crate::pipeline::children);
        let all: Vec<u32> = children.iter().copied().chain(grandchildren).collect();
        all.into_iter()
            .filter_map(|pid| {
                let command = std::fs::read_to_string(format!("/proc/{pid}/cmdline")).ok()?;
                let mut words = command.split('\0').skip_while(|word| *word != "stage");
                Some((words.nth(1)?.to_string(), pid))
            })
            .collect()
    }

    /// Processes of its children whose command line has this word.
    pub fn children_with(&self, word: &str) -> Vec<u32> {
        children(self.pid())
            .into_iter()
            .filter(|pid: &u32| {
                let command = std::fs::read_to_string(format!("/proc/{pid}/cmdline"));
                command.is_ok_and(|command| command.split('\0').any(|found| found == word))
            })
            .collect()
    }

    /// Lines so far.
    pub fn line_count(&self) -> usize {
        self.lines.lock().expect("no panic").len()
    }

    /// stderr so far.
    pub fn log(&self) -> String {
        self.log.lock().expect("no panic").clone()
    }

    /// Waits until `condition`, at most half a minute.
    pub fn wait_until(&mut self, what: &str, condition: impl Fn(&Pipeline) -> bool) {
        let begun = Instant::now();
        while !condition(self) {
            let has_ended = matches!(self.process.try_wait(), Ok(Some(_)));
            let is_late = begun.elapsed() > Duration::from_secs(30);
            assert!(
                !is_late && !has_ended,
                "waiting until {what}: {}",
                self.log()
            );
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Sends a signal to `mluc`.
    pub fn signal(&self, signal: Signal) {
        send_signal(self.pid(), signal);
    }

    /// Waits for the end, at most `patience`.
    pub fn finish_within(mut self, patience: Duration) -> Finished {
        let begun = Instant::now();
        let status = loop {
            if let Some(status) = self.process.try_wait().expect("a child of ours") {
                break status;
            }
            assert!(
                begun.elapsed() < patience,
                "no end within {patience:?}: {}",
                self.log()
            );
            std::thread::sleep(Duration::from_millis(5));
        };
        for reader in self.readers.drain(..) {
            let _ = reader.join();
        }
        let lines = std::mem::take(&mut *self.lines.lock().expect("no panic"));
        Finished {
            code: status.code(),
            lines,
            log: self.log(),
        }
    }

    /// Waits for the end, at most a minute.
    pub fn finish(self) -> Finished {
        self.finish_within(Duration::from_secs(60))
    }
}

impl Drop for Pipeline {
    fn drop(&mut self) {
        // Asked first, so that a test that failed leaves nothing in shared memory.
        if matches!(self.process.try_wait(), Ok(None)) {
            send_signal(self.pid(), Signal::TERM);
        }
        let begun = Instant::now();
        while matches!(self.process.try_wait(), Ok(None))
            && begun.elapsed() < Duration::from_secs(5)
        {
            std::thread::sleep(Duration::from_millis(5));
        }
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn children(pid: u32) -> Vec<u32> {
    let path = format!("/proc/{pid}/task/{pid}/children");
    let children = std::fs::read_to_string(path).unwrap_or_default();
    let pids = children.split_whitespace();
    pids.filter_map(|pid| pid.parse().ok()).collect()
}

/// Sends a signal to any process.
pub fn send_signal(pid: u32, signal: Signal) {
    if let Some(pid) = Pid::from_raw(pid as i32) {
        kill_process(pid, signal).expect("a process of ours");
    }
}
