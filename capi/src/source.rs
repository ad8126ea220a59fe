//! A source's process: it brings the scans of a foreign program into shared memory, in ingest's place.

use crate::error::{Code, Failure};
use mluc_ingest::{decode_bin, inspect_bin};
use mluc_ipc_types::{FrameHeader, Health, HealthState, POINTS_MAX, Point, Stage, Topic};
use mluc_runtime::{
    HealthWatch, Instance, Output, RuntimeError, Shell, Shutdown, StatusWatch, finish,
    log_to_stderr, monotonic_ns, stamp_published, wall_clock_ns,
};
use std::time::{Duration, Instant};

/// Time between two polls.
const TICK: Duration = Duration::from_millis(20);

/// Ports, and what the next scan will be.
pub(crate) struct Source {
    // Ports are dropped before the shell.
    points: Output<Point>,
    healths: HealthWatch,
    statuses: StatusWatch,
    /// The run, since when it is known here, and the sequence of its next scan; `None`: none can be taken yet.
    run_id: u64,
    begun_ns: u64,
    pub(crate) next: Option<u64>,
    shell: Shell,
}

impl Source {
    /// Joins the instance that the environment names, as its ingest.
    pub(crate) fn open() -> Result<Source, RuntimeError> {
        log_to_stderr("source", "info");
        let instance = Instance::from_environment()?;
        let mut shell = Shell::stage(&instance, Stage::Ingest, Shutdown::on_signals()?)?;
        Ok(Source {
            points: shell.output(&Topic::POINTS, POINTS_MAX)?,
            healths: shell.health_watch()?,
            statuses: shell.status_watch()?,
            run_id: 0,
            begun_ns: monotonic_ns(),
            next: None,
            shell,
        })
    }

    /// Sleeps for `time` and sends heartbeats. [`Code::Ok`]: a scan can be taken now; [`Code::Timeout`]: not yet.
    pub(crate) fn wait(&mut self, time: Duration) -> Result<Code, Failure> {
        let begun = Instant::now();
        loop {
            if self.shell.is_stopping() {
                self.shell.state(HealthState::Stopping, Health::ASKED_TO_END)?;
                return Ok(Code::Stopping);
            }
            self.shell.tick()?;
            self.look()?;
            let left = time.saturating_sub(begun.elapsed());
            match self.next {
                Some(_) if left.is_zero() => return Ok(Code::Ok),
                None if left.is_zero() => return Ok(Code::Timeout),
                _ => std::thread::sleep(left.min(TICK)),
            }
        }
    }

    /// Checks whether the later stages take scans of the run, and sets the next sequence: the supervisor's count of scans. The count
    /// must be newer than this process's knowledge of the run, because a predecessor may have sent some scans.
    fn look(&mut self) -> Result<(), RuntimeError> {
        let run_id = self.shell.run().map_or(0, |run| run.run_id);
        if self.run_id != run_id {
            (self.run_id, self.begun_ns, self.next) = (run_id, monotonic_ns(), None);
        }
        if self.next.is_some() {
            return Ok(());
        }
        self.healths.update()?;
        let is_missing = |stage: &&Stage| !self.healths.is_ready(**stage);
        let missing = Stage::ALL[1..].iter().filter(is_missing);
        let mut missing: Vec<&str> = missing.map(|stage| stage.name()).collect();
        let status = (self.statuses.last()?)
            .filter(|status| status.run_id == run_id && status.judged_ns >= self.begun_ns);
        if status.is_none() {
            missing.push("the supervisor");
        }
        if let (Some(status), [], 1..) = (status, &missing[..], run_id) {
            self.next = Some(status.frames_in);
            return self.shell.state(HealthState::Running, "");
        }
        let reason = format!("waiting for {} to be ready", missing.join(", "));
        if self.shell.health.reason() != reason {
            tracing::info!("{reason}");
        }
        self.shell.state(HealthState::WaitingInput, &reason)
    }

    /// Publishes a scan, once [`Source::wait`] says so. Points that are not finite or beyond the limit are left out, counted and flagged.
    pub(crate) fn publish(
        &mut self,
        points: &[Point],
        stamp_ns: u64,
        name: Option<&str>,
    ) -> Result<(), Failure> {
        let started_ns = monotonic_ns();
        let run = self.shell.run().filter(|run| run.run_id == self.run_id);
        let (Some(run), Some(sequence)) = (run, self.next) else {
            let words = "publish: no scan can be taken; call wait until it gives MLUC_OK";
            return Err(Failure::new(Code::Usage, words));
        };
        let number = format!("{sequence:06}");
        let mut header = FrameHeader::new(sequence, name.unwrap_or(&number));
        (header.run_id, header.model_fingerprint) = (run.run_id, run.model_fingerprint);
        let now_ns = wall_clock_ns();
        header.sensor_stamp_ns = if stamp_ns == 0 { now_ns } else { stamp_ns };
        let bytes: &[u8] = bytemuck::cast_slice(points);
        let report = inspect_bin(bytes);
        (header.points_in, header.points_dropped) = (report.points_in, report.dropped());
        header.limit_dropped = report.dropped_over_limit;
        header.flag(report.flags());
        let stamps = header.stamps_mut(Stage::Ingest);
        (stamps.received_ns, stamps.started_ns) = (started_ns, started_ns);
        let mut loan = self.points.loan(&header, report.points_out as usize)?;
        decode_bin(bytes, loan.elements_mut());
        stamp_published(Stage::Ingest, loan.header_mut());
        loan.publish()?;
        self.next = Some(sequence + 1);
        let counters = &mut self.shell.health;
        counters.frames_in += 1;
        counters.bytes_written = report.points_out * size_of::<Point>() as u32;
        Ok(finish(&mut self.shell, Stage::Ingest, &header)?)
    }

    /// Waits until the last scan has passed, at most `patience`, and reports the end of the input.
    pub(crate) fn finish(&mut self, patience: Duration) -> Result<Code, Failure> {
        let begun = Instant::now();
        while let (Some(next @ 1..), Some(status)) = (self.next, self.statuses.last()?)
            && status.sequence != next - 1
            && begun.elapsed() < patience
        {
            if self.wait(TICK)? == Code::Stopping {
                return Ok(Code::Stopping);
            }
        }
        self.shell.state(HealthState::Stopping, "")?;
        Ok(Code::Ok)
    }
}
