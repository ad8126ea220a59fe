//! A stage's process, but for its algorithm: take, check, count, stamp, publish.

use std::time::Duration;

use mluc_ipc_types::{ContractError, FrameHeader, HealthState, Point, Stage, Topic};

use crate::{Frames, Next, Payload, RuntimeError, Scans, Shell, monotonic_ns};

/// Why a stage has no result for a frame.
#[derive(Debug, thiserror::Error)]
pub enum StageError {
    /// The message breaks the contract: refused, counted, and the next one is taken.
    #[error(transparent)]
    Refused(#[from] ContractError),
    /// Shared memory failed: the stage ends.
    #[error(transparent)]
    Runtime(#[from] RuntimeError),
    /// The algorithm failed: the stage ends.
    #[error(transparent)]
    Failed(Box<dyn std::error::Error + Send + Sync>),
}

impl StageError {
    /// For `map_err` on an algorithm's own errors.
    pub fn failed(error: impl std::error::Error + Send + Sync + 'static) -> StageError {
        StageError::Failed(Box::new(error))
    }
}

/// What a stage is, besides its process.
pub trait Algorithm {
    /// Which one.
    const STAGE: Stage;
    /// Element of what it takes.
    type Input: Payload;
    /// Element of what it gives.
    type Output: Payload;

    /// Checks and computes a frame, and says in the header what was out of the ordinary. Gives the elements of the result.
    /// `elements`: the message's, where they lie in shared memory. `points`: the frame's, for the refiner; `None`: they are gone.
    fn run(
        &mut self,
        header: &mut FrameHeader,
        elements: &[Self::Input],
        points: Option<&[Point]>,
    ) -> Result<usize, StageError>;

    /// Work on the points of a frame whose input is still to come, for a stage that holds them: they may be any, and the frame may never come.
    fn read_ahead(&mut self, _header: &FrameHeader, _points: &[Point]) {}

    /// Writes the result to shared memory.
    fn write(&mut self, output: &mut [Self::Output]) -> Result<(), StageError>;

    /// Publishes what goes out before the result; gives its bytes.
    fn publish_aside(&mut self, _header: &FrameHeader) -> Result<usize, RuntimeError> {
        Ok(0)
    }

    /// Adds to what the stage counts.
    fn count(&self, _shell: &mut Shell) {}
}

/// Runs a stage behind ingest until it is asked to end. `elements_max`: of its largest result.
pub fn run_stage<A: Algorithm>(
    shell: &mut Shell,
    elements_max: usize,
    mut algorithm: A,
) -> Result<(), StageError> {
    let stage = A::STAGE;
    // Topics, and whether the scans are held beside them; `None`: they are the input.
    let (from, to, holds) = match stage {
        Stage::Ingest | Stage::Backbone => (&Topic::POINTS, &Topic::FEATURES, None),
        Stage::Head => (&Topic::FEATURES, &Topic::DETECTIONS, Some(false)),
        Stage::Refiner => (&Topic::DETECTIONS, &Topic::OBJECTS, Some(true)),
    };
    let mut output = shell.output::<A::Output>(to, elements_max)?;
    let scans = holds.map(|holds| Scans::open(shell, holds)).transpose()?;
    let mut frames = Frames::<A::Input>::new(shell, from, scans)?;
    let waiting = format!("waiting for {}", frames.name());
    shell.state(HealthState::WaitingInput, &waiting)?;
    loop {
        let ahead = |header: &FrameHeader, points: &[Point]| algorithm.read_ahead(header, points);
        let message = match frames.next_within(shell, ahead, Duration::MAX)? {
            Next::Message(message) => message,
            Next::Stopping => break,
            Next::Timeout => continue,
        };
        let mut header = *message.header();
        let stamps = header.stamps_mut(stage);
        (stamps.received_ns, stamps.started_ns) = (message.received_ns, monotonic_ns());
        shell.note_frame(Some(header.sequence));
        let (elements, points) = (message.elements(), frames.points(header.sequence));
        let bytes_read = size_of_val(elements) + points.map_or(0, size_of_val);
        let count = match algorithm.run(&mut header, elements, points) {
            Ok(count) => count,
            Err(StageError::Refused(error)) => {
                shell.note_frame(None);
                shell.refuse(&error.to_string())?;
                continue;
            }
            Err(error) => return Err(error),
        };
        let bytes_aside = algorithm.publish_aside(&header)?;
        let mut loan = output.loan(&header, count)?;
        algorithm.write(loan.elements_mut())?;
        stamp_published(stage, loan.header_mut());
        loan.publish()?;
        frames.release();
        algorithm.count(shell);
        shell.health.frames_in += 1;
        shell.health.bytes_read = bytes_read as u64;
        shell.health.bytes_written = (bytes_aside + count * size_of::<A::Output>()) as u32;
        shell.health.mappings_verified = frames.mappings_verified();
        finish(shell, stage, &header)?;
    }
    Ok(shell.state(HealthState::Stopping, "")?)
}

/// The last stamp, right before the message is handed over.
pub fn stamp_published(stage: Stage, header: &mut FrameHeader) {
    header.stamps_mut(stage).published_ns = monotonic_ns();
}

/// A frame left: counts it and its time.
pub fn count_frame(shell: &mut Shell, stage: Stage, header: &FrameHeader) {
    let stamps = header.stages[stage as usize];
    if let Some(heartbeat) = &mut shell.heartbeat {
        heartbeat.record_run(monotonic_ns().saturating_sub(stamps.started_ns));
    }
    shell.health.frames_out += 1;
    shell.note_frame(None);
}

/// The same of a stage that has no complaint.
pub fn finish(shell: &mut Shell, stage: Stage, header: &FrameHeader) -> Result<(), RuntimeError> {
    count_frame(shell, stage, header);
    shell.state(HealthState::Running, "")?;
    shell.tick()
}
