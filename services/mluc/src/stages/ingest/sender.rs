//! Reads a scan and publishes it, and checks whether the later stages take frames: a frame that is sent before is lost.

use crate::stages::models::Models;
use anyhow::{Context, Result, ensure};
use crossbeam_channel::{RecvTimeoutError, bounded};
use mluc_ingest::{DecodeReport, Expected, Guard, decode_bin, inspect_bin};
use mluc_ipc_types::{Flags, FrameHeader, HealthState, Object, POINTS_MAX, Point, Stage, Topic};
use mluc_model::{Model, SensorProfile};
use mluc_runtime::{
    HealthWatch, Input, Output, RuntimeError, Shell, count_frame, monotonic_ns, stamp_published,
    wall_clock_ns,
};
use mluc_sources::{Next, Scan, Source};
use std::{panic::resume_unwind, time::Duration, time::Instant};

/// Time between two heartbeats while a file is read.
const READING_TICK: Duration = Duration::from_millis(50);
/// If reading a file takes longer than this, heartbeats stop, and the watchdog ends this process.
const READING_MAX: Duration = Duration::from_secs(5);

/// A scan read from its file, not yet in shared memory.
#[derive(Default)]
pub(crate) struct Loaded {
    sequence: Option<u64>,
    is_set_aside: bool,
    pub(crate) scan: Scan,
    report: DecodeReport,
}

pub(crate) struct Sender<'a> {
    pub(crate) shell: &'a mut Shell,
    pub(crate) source: Source,
    pub(crate) objects: Input<Object>,
    pub(crate) watch: HealthWatch,
    output: Output<Point>,
    suspicion: Suspicion,
    /// A copy of the last scan, which is checked after it was sent.
    again: Vec<Point>,
    pub(crate) loaded: Loaded,
    /// The run of the last frame that was sent.
    run_id: Option<u64>,
    /// At pace `complete`: time between two scans without stamps, ns.
    pub(crate) step_ns: Option<u64>,
}

impl Sender<'_> {
    pub(crate) fn new<'a>(
        shell: &'a mut Shell,
        source: Source,
        model: &Model,
        sensor: Option<SensorProfile>,
        start_sequence: u64,
    ) -> Result<Sender<'a>> {
        let output = shell.output::<Point>(&Topic::POINTS, POINTS_MAX)?;
        let objects = shell.input::<Object>(&Topic::OBJECTS)?;
        let watch = shell.health_watch()?;
        let make =
            move |model: &Model| Ok(Guard::new(Expected::new(&model.manifest, sensor.clone())));
        let guards = Models::new(shell, model, make(model)?, make);
        // Frames that this stage sent before a restart.
        shell.health.frames_in = start_sequence;
        shell.health.frames_out = start_sequence;
        Ok(Sender {
            shell,
            source,
            objects,
            watch,
            output,
            suspicion: Suspicion {
                guards,
                suspected: Flags::default(),
                reason: String::new(),
                missing: String::new(),
            },
            again: Vec::with_capacity(POINTS_MAX),
            loaded: Loaded::default(),
            run_id: None,
            step_ns: None,
        })
    }

    /// Process ids of the later stages; 0: no heartbeat yet.
    pub(crate) fn pids_behind(&self) -> [u32; 3] {
        BEHIND.map(|stage| self.watch.of(stage).map_or(0, |health| health.pid))
    }

    /// Waits until all later stages take frames; false: asked to end.
    pub(crate) fn wait_until_ready(&mut self) -> Result<bool, RuntimeError> {
        let begun = Instant::now();
        let mut said = String::new();
        while !self.shell.is_stopping() {
            self.watch.update()?;
            let missing = BEHIND.into_iter().filter(|stage| !self.watch.is_ready(*stage));
            let missing: Vec<_> = missing.map(Stage::name).collect();
            if missing.is_empty() {
                self.suspicion.tell(self.shell)?;
                return Ok(true);
            }
            let reason = format!("waiting for {} to be ready", missing.join(", "));
            if reason != said && begun.elapsed() > Topic::SILENCE_MAX {
                tracing::info!("{reason}");
                said.clone_from(&reason);
            }
            self.shell.state(HealthState::WaitingInput, &reason)?;
            self.shell.tick()?;
            std::thread::sleep(Duration::from_millis(5));
        }
        Ok(false)
    }

    /// Waits until the supervisor takes more frames; false: asked to end.
    pub(crate) fn wait_while_held(&mut self) -> Result<bool, RuntimeError> {
        while !self.shell.is_stopping() && self.suspicion.guards.control.look().holds {
            let reason = "waiting for the reader of the lines";
            self.shell.state(HealthState::WaitingInput, reason)?;
            self.shell.tick()?;
            std::thread::sleep(Duration::from_millis(5));
        }
        Ok(!self.shell.is_stopping())
    }

    /// Reads the scan of `sequence` from its source, unless it is the one read last; a scan that was set aside is not read. Waits for a
    /// live sensor. False: there is no such scan, this process was asked to end, or `end_ns` has passed.
    pub(crate) fn load(&mut self, sequence: u64, end_ns: u64) -> Result<bool> {
        let set_aside = &self.suspicion.guards.control.look().set_aside;
        let is_set_aside = set_aside.contains(&self.source.index(sequence));
        let is_new = self.loaded.sequence != Some(sequence);
        if !is_new && self.loaded.is_set_aside == is_set_aside {
            return Ok(true);
        }
        self.shell.note_frame(Some(sequence));
        let is_there = self.await_scan(sequence, is_set_aside, end_ns);
        self.shell.note_frame(None);
        if !is_there? {
            return Ok(false);
        }
        let loaded = &mut self.loaded;
        loaded.sequence = Some(sequence);
        loaded.is_set_aside = is_set_aside;
        loaded.report = inspect_bin(&loaded.scan.bytes);
        loaded.scan.flags = loaded.scan.flags.with(loaded.report.flags());
        self.source.missing().clone_into(&mut self.suspicion.missing);
        self.shell.health.frames_in += u64::from(is_new) + loaded.scan.missed;
        self.shell.health.frames_dropped += loaded.scan.missed;
        // Before its first scan the run waits for the stages.
        if loaded.scan.missed > 0 && sequence > 0 {
            tracing::warn!(count = loaded.scan.missed, "scans were passed over");
        }
        Ok(true)
    }

    fn await_scan(&mut self, sequence: u64, is_set_aside: bool, end_ns: u64) -> Result<bool> {
        let mut is_said = false;
        loop {
            match self.read(sequence, is_set_aside)? {
                Next::Scan => return Ok(true),
                Next::NotYet if !self.shell.is_stopping() && monotonic_ns() < end_ns => {
                    if let Some(reason) = self.source.silence() {
                        if !std::mem::replace(&mut is_said, true) {
                            tracing::warn!("{reason}");
                        }
                        self.shell.state(HealthState::Degraded, &reason)?;
                    }
                    self.shell.tick()?;
                }
                Next::NotYet | Next::End => return Ok(false),
            }
        }
    }

    /// Reads a file in a thread while heartbeats are sent, so that a slow disk does not look like a stage that hangs.
    fn read(&mut self, sequence: u64, is_set_aside: bool) -> Result<Next> {
        let (source, scan) = (&mut self.source, &mut self.loaded.scan);
        if is_set_aside {
            return source.pass_over(sequence, scan);
        }
        if source.is_live() {
            return source.load(sequence, scan);
        }
        let (begun, mut is_said) = (Instant::now(), false);
        std::thread::scope(|scope| {
            let (working, ended) = bounded::<()>(0);
            let reading = scope.spawn(move || {
                let _working = working;
                source.load(sequence, scan)
            });
            while ended.recv_timeout(READING_TICK) == Err(RecvTimeoutError::Timeout) {
                if begun.elapsed() > Topic::SILENCE_MAX && !is_said {
                    is_said = true;
                    let reason = format!("reading scan {sequence} takes long");
                    tracing::warn!("{reason}");
                    self.shell.state(HealthState::Degraded, &reason)?;
                }
                // After this time heartbeats stop, and the watchdog ends this process.
                if begun.elapsed() < READING_MAX {
                    self.shell.tick()?;
                }
            }
            reading.join().unwrap_or_else(|panic| resume_unwind(panic))
        })
    }

    /// Publishes the scan that is loaded as `sequence`. `due_ns`: when the scan was due or requested, on the monotonic clock.
    pub(crate) fn send(&mut self, sequence: u64, attempt: u32, due_ns: u64) -> Result<()> {
        let started_ns = monotonic_ns();
        self.shell.note_frame(Some(sequence));
        let (scan, report) = (&self.loaded.scan, self.loaded.report);
        let mut header = FrameHeader::new(sequence, &scan.name);
        let run = self.shell.run().context("the run")?;
        (header.run_id, header.model_fingerprint) = (run.run_id, run.model_fingerprint);
        let last_run = self.run_id.replace(run.run_id);
        ensure!(last_run.is_none_or(|last| last == run.run_id), "another run has begun");
        header.attempt = attempt;
        let at_rate_ns = |step_ns: u64| run.started_ns + sequence * step_ns;
        let read_ns = || self.step_ns.map_or_else(wall_clock_ns, at_rate_ns);
        header.sensor_stamp_ns = scan.stamp_ns.unwrap_or_else(read_ns);
        header.ego = scan.pose.unwrap_or_default();
        header.points_in = report.points_in;
        header.points_dropped = report.dropped();
        header.limit_dropped = report.dropped_over_limit;
        header.flag(scan.flags);
        if attempt > 0 {
            header.flag(Flags::RESENT);
        }
        let stamps = header.stamps_mut(Stage::Ingest);
        (stamps.received_ns, stamps.started_ns) = (due_ns.min(started_ns), started_ns);
        self.suspicion.guards.of_frame(&header)?;
        let mut loan = self.output.loan(&header, report.points_out as usize)?;
        decode_bin(&scan.bytes, loan.elements_mut());
        // A frame that is sent again is not checked again. A check takes some ms: except for the first scans, it follows the sending.
        let looks_later = attempt == 0 && self.suspicion.guards.made.looks_later();
        let is_loop = self.source.count() == Some(1);
        // The first revolution of a capture or a live sensor is incomplete: it would be reported as a covered sensor.
        let is_part = last_run.is_none() && scan.flags.contains(Flags::DAMAGED_INPUT);
        if attempt == 0 && !looks_later && !is_part {
            let points = loan.elements_mut();
            self.suspicion.judge(points, &report, is_loop);
        }
        loan.header_mut().flag(self.suspicion.suspected);
        stamp_published(Stage::Ingest, loan.header_mut());
        loan.publish()?;
        self.shell.health.bytes_written = (report.points_out as usize * size_of::<Point>()) as u32;
        self.shell.health.mappings_verified = self.objects.mappings_verified();
        if attempt > 0 {
            // The same frame is counted once.
            self.shell.health.frames_out -= 1;
        }
        count_frame(self.shell, Stage::Ingest, &header);
        if looks_later {
            self.again.resize(report.points_out as usize, Point::default());
            decode_bin(&self.loaded.scan.bytes, &mut self.again);
            self.suspicion.judge(&self.again, &report, is_loop);
        }
        self.suspicion.tell(self.shell)?;
        Ok(self.shell.tick()?)
    }
}

/// The result of the guard's checks of the input.
struct Suspicion {
    guards: Models<Guard>,
    /// The flags of the frames that follow.
    suspected: Flags,
    /// The first reason for these flags; empty: none.
    reason: String,
    /// Those of several sensors that give nothing; empty: none.
    missing: String,
}

impl Suspicion {
    /// Compares a scan with what is expected; logs reasons that the scan before did not have. `is_loop`: one scan is repeated on purpose.
    fn judge(&mut self, points: &[Point], report: &DecodeReport, is_loop: bool) {
        let reasons = self.guards.made.check(points, report).iter();
        let reasons = reasons.filter(|reason| !is_loop || reason.flag() != Flags::SUSPECT_FROZEN);
        let (mut suspected, mut first) = (Flags::default(), None);
        for reason in reasons {
            suspected = suspected.with(reason.flag());
            first = first.or(Some(reason));
            if !self.suspected.contains(reason.flag()) {
                tracing::warn!("suspect input: {reason}");
            }
        }
        if suspected != self.suspected {
            self.suspected = suspected;
            let reason = first.map(|reason| format!("suspect input: {reason}"));
            self.reason = reason.unwrap_or_default();
        }
    }

    /// Sets the state that follows from these fields.
    fn tell(&self, shell: &mut Shell) -> Result<(), RuntimeError> {
        if !self.missing.is_empty() {
            let reason = format!("no scans of lidar{}", self.missing);
            return shell.state(HealthState::Degraded, &reason);
        }
        match self.reason.as_str() {
            "" => shell.state(HealthState::Running, ""),
            reason => shell.state(HealthState::Degraded, reason),
        }
    }
}

/// The stages that a frame still has to pass.
const BEHIND: [Stage; 3] = [Stage::Backbone, Stage::Head, Stage::Refiner];
