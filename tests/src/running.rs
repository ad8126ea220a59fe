//! Runs `mluc`, or another program's stage, as a process.

use mluc_runtime::{HealthWatch, Instance, Shell, Shutdown};
use procfs::process::Process;
use rustix::process::{Pid, Signal, kill_process, test_kill_process};
use serde_json::Value;
use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};
use std::{ffi::OsStr, path::PathBuf, sync::Arc, sync::Mutex, thread::JoinHandle};

/// A program next to the tests that cargo built: `target/release/deps/test-1234` has it in `target/release`.
pub fn built_program(name: &str) -> PathBuf {
    let test = std::env::current_exe().expect("a running test");
    let folder = test.ancestors().nth(2).expect("target/PROFILE");
    let program = folder.join(name);
    assert!(
        program.exists(),
        "{} is missing: run `cargo test --workspace`, or build it with the same profile first (`cargo build -p mluc -p \
         mluc-contract --bins`)",
        program.display()
    );
    program
}

pub fn mluc_program() -> PathBuf {
    built_program("mluc")
}

/// A name that no other test uses.
pub fn unique_instance(label: &str) -> String {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    // Short: a long user number leaves few characters.
    format!("{label:.3}-{:x}-{count}", std::process::id())
}

/// Files in shared memory that belong to an instance.
pub fn leftovers(instance: &str) -> Vec<String> {
    let stem = format!("mluc-{}-{instance}", rustix::process::geteuid().as_raw());
    let folder = std::fs::read_dir("/dev/shm").expect("shared memory");
    let entries = folder.flatten();
    entries
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .filter(|name| *name == stem || name.starts_with(&format!("{stem}.")))
        .collect()
}

pub fn send_signal(pid: u32, signal: Signal) {
    if let Some(pid) = Pid::from_raw(pid as i32) {
        kill_process(pid, signal).expect("a process of ours");
    }
}

pub fn is_alive(pid: u32) -> bool {
    Pid::from_raw(pid as i32).is_some_and(|pid| test_kill_process(pid).is_ok())
}

/// Waits at most `patience`; returns whether `condition` became true.
pub fn wait_for(patience: Duration, mut condition: impl FnMut() -> bool) -> bool {
    let begun = Instant::now();
    loop {
        if condition() {
            return true;
        }
        if begun.elapsed() > patience {
            return false;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[track_caller]
pub fn assert_has(text: &str, words: &[&str]) {
    for word in words {
        assert!(text.contains(word), "'{word}' is missing in: {text}");
    }
}

#[derive(Debug)]
pub struct Finished {
    /// Exit code; `None`: a signal ended the process.
    pub code: Option<i32>,
    /// stdout, one value per line.
    pub lines: Vec<Value>,
    pub log: String,
}

impl Finished {
    /// Fails unless the process ended with this code and wrote exactly this many lines.
    #[track_caller]
    pub fn assert_ended(&self, code: i32, lines: usize) {
        let found = (self.code, self.lines.len());
        assert_eq!(found, (Some(code), lines), "{}", self.log);
    }

    /// Fails unless the process ended well; a loaded machine may have lost frames.
    #[track_caller]
    pub fn assert_ended_well(&self) {
        assert!(matches!(self.code, Some(0 | 3)), "{}", self.log);
    }

    /// Fails unless the process ended with this code after exactly the frames 0, 1, 2 and so on, each once and in order.
    #[track_caller]
    pub fn assert_complete(&self, code: i32, frames: u64) {
        let found = (self.code, self.sequences());
        assert_eq!(found, (Some(code), (0..frames).collect()), "{}", self.log);
    }

    #[track_caller]
    pub fn assert_says(&self, words: &[&str]) {
        assert_has(&self.log, words);
    }

    pub fn frames(&self) -> Vec<&str> {
        let frames = self.lines.iter().map(|line| line["frame"].as_str());
        frames.map(|frame| frame.unwrap_or("?")).collect()
    }

    pub fn sequences(&self) -> Vec<u64> {
        self.lines.iter().filter_map(|line| line["sequence"].as_u64()).collect()
    }

    /// stdout as text.
    pub fn text(&self) -> String {
        let lines: Vec<&str> = self.lines.iter().filter_map(Value::as_str).collect();
        lines.join("\n")
    }

    pub fn flags(&self, frame: &str) -> Vec<&str> {
        let line = self.lines.iter().find(|line| line["frame"] == frame);
        let line = line.unwrap_or_else(|| panic!("no line of frame {frame}: {}", self.log));
        line["flags"].as_array().into_iter().flatten().filter_map(Value::as_str).collect()
    }
}

/// The text that was read so far, and the reading thread.
type Reader = (Arc<Mutex<String>>, JoinHandle<()>);

/// A running program; it is ended when this value is dropped.
pub struct Running {
    process: Child,
    out: Reader,
    log: Reader,
}

impl Running {
    pub fn mluc<S: AsRef<OsStr>>(arguments: impl IntoIterator<Item = S>) -> Running {
        Running::start(Command::new(mluc_program()).args(arguments))
    }

    pub fn start(command: &mut Command) -> Running {
        Running::start_into(command, Stdio::piped(), Stdio::piped())
    }

    /// Starts the command; piped output is read.
    pub fn start_into(command: &mut Command, stdout: Stdio, stderr: Stdio) -> Running {
        command.stdin(Stdio::null()).stdout(stdout).stderr(stderr);
        let mut process = command.spawn().expect("the program starts");
        let (out, log) = (process.stdout.take(), process.stderr.take());
        Running {
            out: out.map_or_else(|| read_lines(std::io::empty()), read_lines),
            log: log.map_or_else(|| read_lines(std::io::empty()), read_lines),
            process,
        }
    }

    pub fn pid(&self) -> u32 {
        self.process.id()
    }

    /// Name and process id of its stages.
    pub fn stages(&self) -> Vec<(String, u32)> {
        let stage = |(pid, words): (u32, Vec<String>)| {
            let mut words = words.into_iter().skip_while(|word| word != "stage");
            Some((words.nth(1)?, pid))
        };
        self.descendants().into_iter().filter_map(stage).collect()
    }

    /// The process id of a running stage.
    #[track_caller]
    pub fn stage(&self, name: &str) -> u32 {
        let stages = self.stages();
        let found = stages.iter().find(|(stage, _)| stage == name);
        let (_, pid) = found.unwrap_or_else(|| panic!("no {name} in {stages:?}"));
        *pid
    }

    /// The processes that this one started and whose command line has this word.
    pub fn children_with(&self, word: &str) -> Vec<u32> {
        let mut found = self.descendants();
        found.retain(|(_, words)| words.iter().any(|found| found == word));
        found.into_iter().map(|(pid, _)| pid).collect()
    }

    /// Processes and their command lines, over several levels: `mluc bench` starts a `mluc up`, whose children are the stages.
    fn descendants(&self) -> Vec<(u32, Vec<String>)> {
        let children = children(self.pid());
        let grandchildren = children.iter().flat_map(|pid| self::children(*pid));
        let all = children.iter().copied().chain(grandchildren);
        let with_command = |pid| Some((pid, Process::new(pid as i32).ok()?.cmdline().ok()?));
        all.filter_map(with_command).collect()
    }

    /// The number of lines so far.
    pub fn line_count(&self) -> usize {
        self.out.0.lock().expect("no panic").lines().count()
    }

    /// stderr so far.
    pub fn log(&self) -> String {
        self.log.0.lock().expect("no panic").clone()
    }

    /// Waits until `condition` is true, at most half a minute.
    #[track_caller]
    pub fn wait_until(&mut self, what: &str, mut condition: impl FnMut(&Running) -> bool) {
        let (mut is_met, mut has_ended) = (false, false);
        wait_for(Duration::from_secs(30), || {
            is_met = condition(self);
            has_ended = matches!(self.process.try_wait(), Ok(Some(_)));
            is_met || has_ended
        });
        assert!(is_met, "waiting until {what}: {}", self.log());
    }

    /// Waits for `more` further lines.
    #[track_caller]
    pub fn wait_for_lines(&mut self, more: usize) {
        let before = self.line_count();
        self.wait_until("frames flow", |run| run.line_count() >= before + more);
    }

    #[track_caller]
    pub fn wait_for_words(&mut self, words: &str) {
        self.wait_until(words, |run| run.log().contains(words));
    }

    /// The address that the program reports that it serves, once it has written these words.
    #[track_caller]
    pub fn wait_for_address(&mut self, words: &str) -> String {
        self.wait_for_words(words);
        let log = self.log();
        let (_, rest) = log.split_once("http://").expect("the address");
        rest.split(' ').next().expect("a word").to_string()
    }

    /// Waits until the health of an instance's stages fulfils a condition.
    #[track_caller]
    pub fn wait_for_health(
        &mut self,
        instance: &str,
        what: &str,
        mut is_right: impl FnMut(&HealthWatch) -> bool,
    ) {
        let instance = Instance::new(instance).expect("a name");
        let shell = Shell::observer(&instance, None, Shutdown::default()).expect("it runs");
        let mut watch = shell.health_watch().expect("it runs");
        self.wait_until(what, |_| {
            watch.update().expect("it runs");
            is_right(&watch)
        });
    }

    /// Sends a stage a signal that ends it sooner or later, and waits for its next process.
    #[track_caller]
    pub fn replace(&mut self, stage: &str, signal: Signal) {
        let hit = self.stage(stage);
        send_signal(hit, signal);
        self.wait_until("it has another process", |run| {
            run.stages().into_iter().any(|(name, pid)| name == stage && pid != hit)
        });
        assert!(!is_alive(hit));
    }

    pub fn signal(&self, signal: Signal) {
        send_signal(self.pid(), signal);
    }

    /// Waits for the end, at most `patience`.
    #[track_caller]
    pub fn finish_within(mut self, patience: Duration) -> Finished {
        let mut status = None;
        wait_for(patience, || {
            status = self.process.try_wait().expect("a child of ours");
            status.is_some() && self.out.1.is_finished() && self.log.1.is_finished()
        });
        let status = status.unwrap_or_else(|| panic!("no end within {patience:?}: {}", self.log()));
        let value = |line: &str| serde_json::from_str(line).unwrap_or(Value::String(line.into()));
        let (out, log) = (self.out.0.lock().expect("no panic"), self.log());
        assert!(!log.contains("outlives its shell"), "{log}");
        Finished { code: status.code(), lines: out.lines().map(value).collect(), log }
    }

    /// Waits for the end, at most a minute.
    #[track_caller]
    pub fn finish(self) -> Finished {
        self.finish_within(Duration::from_secs(60))
    }

    /// Asks the program to end; it must end without an error.
    #[track_caller]
    pub fn stop(self) -> Finished {
        self.signal(Signal::TERM);
        let ended = self.finish();
        assert_eq!(ended.code, Some(0), "{}", ended.log);
        ended
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // A request to end comes first, so that a failed test leaves nothing in shared memory.
        if matches!(self.process.try_wait(), Ok(None)) {
            send_signal(self.pid(), Signal::TERM);
        }
        let has_ended = || !matches!(self.process.try_wait(), Ok(None));
        wait_for(Duration::from_secs(5), has_ended);
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Keeps whole lines only: a reader never sees a part of one.
fn read_lines(from: impl Read + Send + 'static) -> Reader {
    let text: Arc<Mutex<String>> = Arc::default();
    let own = text.clone();
    let reader = std::thread::spawn(move || {
        let lines = BufReader::new(from).split(b'\n').map_while(Result::ok);
        for line in lines {
            *own.lock().expect("no panic") += &(String::from_utf8_lossy(&line) + "\n");
        }
    });
    (text, reader)
}

fn children(pid: u32) -> Vec<u32> {
    let task = Process::new(pid as i32).and_then(|process| process.task_main_thread());
    task.and_then(|task| task.children()).unwrap_or_default()
}
