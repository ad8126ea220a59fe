//! The frames of a topic as a stage takes them: the newest one of this run and this model, that ingest has sent and that
//! does not go back. All others are refused and counted.

use std::fmt::Debug;
use std::time::Duration;

use bytemuck::Pod;
use iceoryx2::prelude::ZeroCopySend;
use mluc_ipc_types::{ContractError, FrameHeader, Point, Topic};

use crate::{Input, Message, Next, RuntimeError, Scans, Shell};

/// A topic's frames.
pub struct Frames<T: Pod + Debug + ZeroCopySend> {
    input: Input<T>,
    topic: Topic,
    /// `None`: the topic is ingest's own.
    scans: Option<Scans>,
    run_id: u64,
    last: Option<u64>,
    dropped: u64,
}

impl<T: Pod + Debug + ZeroCopySend> Frames<T> {
    /// Of the topic that ingest sends.
    pub fn of_ingest(shell: &Shell, topic: &Topic) -> Result<Frames<T>, RuntimeError> {
        Frames::open(shell, topic, None)
    }

    /// Of a later topic; the topic `points` tells what ingest has sent.
    pub fn new(shell: &Shell, topic: &Topic) -> Result<Frames<T>, RuntimeError> {
        let scans = Scans::sent(shell.side_input(&Topic::POINTS)?);
        Frames::open(shell, topic, Some(scans))
    }

    /// The same, and the points of a frame are held for it.
    pub fn with_points(shell: &Shell, topic: &Topic) -> Result<Frames<T>, RuntimeError> {
        let scans = Scans::held(shell.side_input(&Topic::POINTS)?);
        Frames::open(shell, topic, Some(scans))
    }

    fn open(shell: &Shell, topic: &Topic, scans: Option<Scans>) -> Result<Frames<T>, RuntimeError> {
        Ok(Frames {
            input: shell.input(topic)?,
            topic: *topic,
            scans,
            run_id: 0,
            last: None,
            dropped: 0,
        })
    }

    /// Of which topic.
    pub fn topic(&self) -> &Topic {
        &self.topic
    }

    /// Waits for the newest frame; `None`: this process was asked to end.
    pub fn next(&mut self, shell: &mut Shell) -> Result<Option<Message<T>>, RuntimeError> {
        loop {
            match self.next_within(shell, Duration::MAX)? {
                Next::Message(message) => return Ok(Some(message)),
                Next::Stopping => return Ok(None),
                Next::Timeout => (),
            }
        }
    }

    /// The same, and gives up after `timeout`, or when a frame was refused.
    pub fn next_within(
        &mut self,
        shell: &mut Shell,
        timeout: Duration,
    ) -> Result<Next<T>, RuntimeError> {
        if let Some(stop) = shell.await_run(timeout)? {
            return Ok(stop);
        }
        let scans = &mut self.scans;
        let next = shell.next_within(
            &mut self.input,
            &self.topic,
            |run| match (&mut *scans, run) {
                (Some(scans), Some(run)) => scans.take(run),
                _ => Ok(()),
            },
            timeout,
        )?;
        if let Next::Message(message) = &next
            && let Err(error) = self.admit(shell, message.header())?
        {
            shell.refuse(&error.to_string())?;
            return Ok(Next::Timeout);
        }
        shell.counters.frames_dropped = self.dropped;
        Ok(next)
    }

    /// Whether the frame may be used.
    fn admit(
        &mut self,
        shell: &mut Shell,
        header: &FrameHeader,
    ) -> Result<Result<(), ContractError>, RuntimeError> {
        let Some(run) = shell.run() else {
            return Ok(Ok(()));
        };
        if self.run_id != run.run_id {
            (self.run_id, self.last) = (run.run_id, None);
        }
        let sent = match &mut self.scans {
            Some(scans) => {
                scans.take(run)?;
                scans.count_sent()
            }
            None => header.sequence.saturating_add(1),
        };
        let sequences = self.last.unwrap_or(0)..sent;
        if let Err(error) = shell
            .check_model()
            .and_then(|()| header.checked_in(run, sequences).map(drop))
        {
            return Ok(Err(error));
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

    /// A frame was worked on: lets go the points that no later frame can ask for.
    pub fn release(&mut self) {
        if let Some(scans) = &mut self.scans {
            scans.let_go();
        }
    }

    /// Payloads that were found inside a mapped segment of the instance.
    pub fn mappings_verified(&self) -> u64 {
        let of_scans = self
            .scans
            .as_ref()
            .map_or(0, |scans| scans.input().mappings_verified());
        self.input.mappings_verified() + of_scans
    }
}
