//! A running `mluc up`, its lines as they come, and its stages' processes.

use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use mluc_ipc_types::Stage;
use procfs::process::Process;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use crate::machine::children;

/// How a pipeline is started.
pub(super) struct Start {
    pub(super) program: PathBuf,
    pub(super) input: PathBuf,
    pub(super) config: PathBuf,
    pub(super) instance: String,
}

/// Far more than come between two looks.
const LINES_WAITING: usize = 10_000;

/// A line of the pipeline, and when it came.
pub(super) struct Line {
    pub(super) at: Instant,
    /// When each stage published the frame.
    published: [Instant; 4],
    pub(super) sequence: u64,
    pub(super) frame: String,
    /// What the scan alone decides; none where the frame's time or points ran out.
    pub(super) objects: Option<String>,
}

impl Line {
    /// Whether the frame passed all these stages after `at`: else it was past one of them already.
    pub(super) fn passed_after(&self, at: Instant, stages: &[Stage]) -> bool {
        stages
            .iter()
            .all(|stage| self.published[*stage as usize] > at)
    }
}

/// The objects of each scan in a run in which nothing happened.
pub(super) type Reference = BTreeMap<String, String>;

pub(super) struct Pipeline {
    process: Child,
    lines: Receiver<Line>,
    log: Option<JoinHandle<String>>,
    pub(super) next_sequence: u64,
    pub(super) received: u64,
    pub(super) skipped: u64,
    pub(super) wrong: u64,
    instance: String,
}

/// How it ended.
pub(super) struct End {
    pub(super) code: Option<i32>,
    /// In, out, lost and under way, by its summary.
    pub(super) frames: Option<[u64; 4]>,
    pub(super) files_left: usize,
    pub(super) log: String,
}

impl Pipeline {
    pub(super) fn start(start: &Start, options: &str) -> Result<Pipeline> {
        let mut command = Command::new(&start.program);
        command.arg("up").arg("--input").arg(&start.input);
        command.arg("--config").arg(&start.config);
        command.args(["--instance", &start.instance]);
        command.args(options.split_whitespace());
        command.stdin(Stdio::null());
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut process = command.spawn().context("starting mluc up")?;
        let (sender, lines) = sync_channel(LINES_WAITING);
        let out = process.stdout.take().context("stdout")?;
        std::thread::spawn(move || {
            let lines = BufReader::new(out).lines().map_while(Result::ok);
            let mut parsed = lines.filter_map(|line| parse(&line, Instant::now()));
            // An error: nobody waits for lines any more.
            let _ = parsed.all(|line| sender.send(line).is_ok());
        });
        let mut err = process.stderr.take().context("stderr")?;
        let log = std::thread::spawn(move || {
            let mut bytes = Vec::new();
            let _ = err.read_to_end(&mut bytes);
            String::from_utf8_lossy(&bytes).into_owned()
        });
        Ok(Pipeline {
            process,
            lines,
            log: Some(log),
            next_sequence: 0,
            received: 0,
            skipped: 0,
            wrong: 0,
            instance: start.instance.clone(),
        })
    }

    /// The next line, counted and compared; `None`: none came in time.
    pub(super) fn line_within(
        &mut self,
        patience: Duration,
        reference: &Reference,
    ) -> Result<Option<Line>> {
        let line = match self.lines.recv_timeout(patience) {
            Ok(line) => line,
            Err(RecvTimeoutError::Timeout) => return Ok(None),
            Err(RecvTimeoutError::Disconnected) => bail!("the pipeline ended: {}", self.end().log),
        };
        self.count(&line, reference);
        Ok(Some(line))
    }

    fn count(&mut self, line: &Line, reference: &Reference) {
        let scans = reference.len() as u64;
        let expected = (scans > 0).then(|| reference.iter().nth((line.sequence % scans) as usize));
        let is_wrong = expected.flatten().is_some_and(|(frame, objects)| {
            *frame != line.frame || line.objects.as_ref().is_some_and(|own| own != objects)
        });
        self.wrong += u64::from(is_wrong || line.sequence < self.next_sequence);
        self.received += 1;
        self.skipped += line.sequence.saturating_sub(self.next_sequence);
        self.next_sequence = line.sequence + 1;
    }

    /// Until the first stages run.
    pub(super) fn wait_for_a_stage(&self) -> Result<()> {
        let begun = Instant::now();
        while !Stage::ALL.iter().any(|stage| self.stage(*stage).is_some()) {
            ensure!(begun.elapsed().as_secs() < 10, "no stage within 10 s");
            std::thread::sleep(Duration::from_millis(1));
        }
        Ok(())
    }

    /// The process of a stage; `None`: there is none at this time.
    pub(super) fn stage(&self, stage: Stage) -> Option<Pid> {
        let is_stage = |pid: &u32| {
            let command = Process::new(*pid as i32).and_then(|process| process.cmdline());
            command.is_ok_and(|words| match words.get(1).map(String::as_str) {
                Some("stage") => words.get(2).is_some_and(|name| name == stage.name()),
                Some("clean") => false,
                // Neither a stage of ours nor a helper: the program in the refiner's place.
                _ => stage == Stage::Refiner,
            })
        };
        let found = children(self.process.id())?.into_iter().find(is_stage)?;
        Pid::from_raw(found as i32)
    }

    pub(super) fn signal(&self, signal: Signal) {
        // It may have ended already; it is not waited for before `end`.
        let pid = Pid::from_raw(self.process.id() as i32);
        let _ = pid.map(|pid| kill_process(pid, signal));
    }

    /// Waits for the end and reads the summary. After 10 s it is killed.
    pub(super) fn end(&mut self) -> End {
        let begun = Instant::now();
        let status = loop {
            match self.process.try_wait() {
                Ok(Some(status)) => break Some(status),
                _ if begun.elapsed() > Duration::from_secs(10) => {
                    let _ = self.process.kill();
                    let _ = self.process.wait();
                    break None;
                }
                _ => std::thread::sleep(Duration::from_millis(2)),
            }
        };
        let files_left = files(&self.instance);
        let log = self.log.take().and_then(|log| log.join().ok());
        let log = log.unwrap_or_default();
        End {
            code: status.and_then(|status| status.code()),
            frames: summary(&log),
            files_left,
            log,
        }
    }

    /// Lines that were written and not yet counted.
    pub(super) fn drain(&mut self, reference: &Reference) {
        while let Ok(line) = self.lines.recv_timeout(Duration::from_millis(200)) {
            self.count(&line, reference);
        }
    }
}

impl Drop for Pipeline {
    fn drop(&mut self) {
        if matches!(self.process.try_wait(), Ok(None)) {
            self.signal(Signal::TERM);
            self.end();
        }
    }
}

fn parse(line: &str, at: Instant) -> Option<Line> {
    let value: Value = serde_json::from_str(line).ok()?;
    let flags = value["flags"].as_array()?;
    let is_whole = ["limit_work", "points_gone", "degraded", "damaged_input"];
    let is_whole = !flags
        .iter()
        .any(|flag| is_whole.iter().any(|word| flag == word));
    let objects = is_whole.then(|| format!("{}{}", value["objects"], value["suppressed"]));
    let us = |value: &Value| value.as_u64().map(Duration::from_micros);
    let mut published = [at.checked_sub(us(&value["latency_us"])?)?; 4];
    for (index, stage) in Stage::ALL.into_iter().enumerate() {
        let times = &value["stages"][stage.name()];
        let took = us(&times["queue_us"])? + us(&times["run_us"])?;
        published[index..].iter_mut().for_each(|time| *time += took);
    }
    Some(Line {
        at,
        published,
        sequence: value["sequence"].as_u64()?,
        frame: value["frame"].as_str()?.to_string(),
        objects,
    })
}

/// `frames: 23 in, 21 out, 1 lost, 1 under way at the end; ..`
fn summary(log: &str) -> Option<[u64; 4]> {
    let line = log
        .lines()
        .rev()
        .find_map(|line| line.strip_prefix("frames: "))?;
    let part = |word: &str| {
        let parts = line.split([',', ';']).map(str::trim);
        let mut pairs = parts.filter_map(|part| part.split_once(' '));
        let found = pairs.find(|(_, what)| what.starts_with(word));
        found.and_then(|(number, _)| number.parse().ok())
    };
    let under_way = part("under way").unwrap_or(0);
    Some([part("in")?, part("out")?, part("lost")?, under_way])
}

/// Of an instance, in shared memory.
fn files(instance: &str) -> usize {
    let stem = format!("mluc-{}-{instance}", rustix::process::geteuid().as_raw());
    let entries = fs::read_dir("/dev/shm").into_iter().flatten().flatten();
    let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
    names
        .filter(|name| *name == stem || name.starts_with(&format!("{stem}.")))
        .count()
}

/// Each scan's objects, from a run in which nothing happens.
pub(super) fn reference(start: &Start) -> Result<Reference> {
    let mut pipeline = Pipeline::start(start, "--pace complete")?;
    let mut reference = Reference::new();
    while let Ok(line) = pipeline.lines.recv_timeout(Duration::from_secs(60)) {
        reference.insert(line.frame, line.objects.unwrap_or_default());
    }
    let end = pipeline.end();
    ensure!(
        end.code == Some(0),
        "the pipeline does not run: {}",
        end.log
    );
    Ok(reference)
}
