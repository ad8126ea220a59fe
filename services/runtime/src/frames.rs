//! The frames of a topic as a stage takes them: the newest frame of this run and its model that ingest has sent and whose
//! sequence does not go backwards. All other frames are refused and counted.

use crate::{Input, Next, Payload, Scans, Shell, error::Result, monotonic_ns};
use mluc_ipc_types::{ContractError, FrameHeader, Point, RunDescription, Topic};
use std::time::Duration;

/// A topic's frames.
pub struct Frames<T: Payload> {
    input: Input<T>,
    /// `None`: the topic is the one that ingest itself sends.
    scans: Option<Scans>,
    run_id: u64,
    last: Option<u64>,
    dropped: u64,
}

impl<T: Payload> Frames<T> {
    /// Opens a topic. `scans` reports what ingest has sent, and may keep the points of each frame; `None` for the topic that ingest itself sends.
    pub fn new(shell: &Shell, topic: &Topic, scans: Option<Scans>) -> Result<Frames<T>> {
        Ok(Frames { input: shell.input(topic)?, scans, run_id: 0, last: None, dropped: 0 })
    }

    pub(crate) fn name(&self) -> &str {
        self.input.name()
    }

    /// Waits for the newest frame. Returns [`Next::Timeout`] after `timeout`, and also when a frame was refused. While it waits, `ahead` gets
    /// the scan of the next frame, if scans are kept.
    pub fn next_within(
        &mut self,
        shell: &mut Shell,
        mut ahead: impl FnMut(&FrameHeader, &[Point]),
        timeout: Duration,
    ) -> Result<Next<T>> {
        let begun_ns = monotonic_ns();
        if !shell.await_run(timeout)? {
            let stopping = shell.is_stopping().then_some(Next::Stopping);
            return Ok(stopping.unwrap_or(Next::Timeout));
        }
        let (scans, last) = (&mut self.scans, (self.run_id, self.last));
        let take_scans = |run: Option<&RunDescription>, has_time: bool| {
            let (Some(scans), Some(run)) = (scans.as_mut(), run) else {
                return Ok(None);
            };
            scans.take(run, |_| ())?;
            let done = match last {
                (run_id, Some(last)) if run_id == run.run_id => last + 1,
                _ => 0,
            };
            if let Some(scan) = has_time.then(|| scans.ahead(done)).flatten() {
                ahead(scan.header(), scan.elements());
            }
            // No frame is in the pipeline: the next message to arrive is a scan.
            let is_idle = scans.count_sent() <= done;
            if is_idle && has_time {
                scans.let_orphans_go();
            }
            Ok(is_idle.then(|| scans.wake()).flatten())
        };
        let left = timeout.saturating_sub(Duration::from_nanos(monotonic_ns() - begun_ns));
        let next = shell.next_within(&mut self.input, take_scans, left)?;
        if let Next::Message(message) = &next
            && let Err(error) = self.admit(shell, message.header())?
        {
            // An observer gets the last frame from before it joined, whose scan it has not seen, and resent frames. It skips both silently.
            let is_known = match error {
                ContractError::Sequence { end, found, .. } => end == 0 || Some(found) == self.last,
                _ => false,
            };
            if !is_known || shell.heartbeat.is_some() {
                shell.refuse(&error.to_string())?;
            }
            return Ok(Next::Timeout);
        }
        shell.health.frames_dropped = self.dropped;
        Ok(next)
    }

    /// Whether the frame may be used.
    fn admit(
        &mut self,
        shell: &Shell,
        header: &FrameHeader,
    ) -> Result<std::result::Result<(), ContractError>> {
        let Some(run) = shell.run() else {
            return Ok(Ok(()));
        };
        if self.run_id != run.run_id {
            (self.run_id, self.last) = (run.run_id, None);
        }
        let mut sent = header.sequence.saturating_add(1);
        if let Some(scans) = &mut self.scans {
            scans.take(run, |_| ())?;
            sent = scans.count_sent();
        }
        // A stage processes a resent frame again; an observer does not.
        let next = u64::from(shell.heartbeat.is_none());
        let sequences = self.last.map_or(0, |last| last + next)..sent;
        let checked = header.checked_in(run, sequences).map(drop);
        if checked.is_err() {
            return Ok(checked);
        }
        if let Some(last) = self.last {
            let gap = header.sequence.saturating_sub(last.saturating_add(1));
            self.dropped = self.dropped.saturating_add(gap);
        }
        self.last = Some(header.sequence);
        Ok(Ok(()))
    }

    /// The points of a frame where they lie in shared memory; `None`: they are gone, or break the contract.
    pub fn points(&self, sequence: u64) -> Option<&[Point]> {
        let scan = self.scans.as_ref()?.of(sequence)?;
        Point::checked(scan.header(), scan.elements()).ok()
    }

    /// Called when a frame is done: releases the points that no later frame can need.
    pub fn release(&mut self) {
        if let Some(scans) = &mut self.scans {
            scans.let_go();
        }
    }

    /// Payloads that were found inside a mapped segment of the instance.
    pub fn mappings_verified(&self) -> u64 {
        let of_scans = self.scans.as_ref().map_or(0, Scans::mappings_verified);
        self.input.mappings_verified() + of_scans
    }
}
