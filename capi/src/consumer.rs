//! A consumer's process: the newest frame of a pipeline, and the pipeline's status.

use crate::error::{Code, Failure};
use mluc_ipc_types::{FrameHeader, Object, Point, RunDescription, Status, Topic};
use mluc_runtime::{
    Frames, Input, Instance, Message, Next, RuntimeError, Scans, Shell, Shutdown, StatusWatch,
    log_to_stderr, monotonic_ns,
};
use std::time::Duration;

/// Ports, and the frame that was given last.
pub(crate) struct Consumer {
    // Ports and messages are dropped before the shell.
    pub(crate) frame: Option<Frame>,
    frames: Frames<Object>,
    object_points: Input<u32>,
    newest: Option<Message<u32>>,
    statuses: StatusWatch,
    pub(crate) status: Option<Status>,
    shell: Shell,
}

/// A frame whose objects were checked. Copies: what lies in shared memory may change after the check.
pub(crate) struct Frame {
    pub(crate) header: FrameHeader,
    pub(crate) objects: Vec<Object>,
    /// Indices of the objects' points; none if they, or the points, are gone.
    pub(crate) indices: Vec<u32>,
}

impl Consumer {
    /// Joins the instance that the environment names; a pipeline need not run there yet.
    pub(crate) fn open() -> Result<Consumer, RuntimeError> {
        log_to_stderr("consumer", "info");
        let instance = Instance::from_environment()?;
        let shell = Shell::observer(&instance, None, Shutdown::on_signals()?)?;
        let scans = Scans::open(&shell, true)?;
        Ok(Consumer {
            frame: None,
            frames: Frames::new(&shell, &Topic::OBJECTS, Some(scans))?,
            object_points: shell.side_input(&Topic::OBJECT_POINTS)?,
            newest: None,
            statuses: shell.status_watch()?,
            status: None,
            shell,
        })
    }

    /// Waits for the newest frame that keeps the contract; others are refused and logged. [`Code::Ok`]: it came.
    pub(crate) fn wait(&mut self, timeout: Duration) -> Result<Code, Failure> {
        // Only after a frame: before the first frame comes, the oldest scan may belong to it.
        if self.frame.take().is_some() {
            self.frames.release();
        }
        let begun_ns = monotonic_ns();
        loop {
            let spent = Duration::from_nanos(monotonic_ns() - begun_ns);
            let left = timeout.saturating_sub(spent);
            let next = (self.frames).next_within(&mut self.shell, |_, _| (), left)?;
            self.status = self.statuses.update()?;
            match next {
                Next::Message(message) => match self.checked(&message) {
                    Ok(frame) => {
                        self.frame = Some(frame);
                        return Ok(Code::Ok);
                    }
                    Err(failure) => {
                        self.shell.refuse(&failure.words)?;
                        self.frames.release();
                    }
                },
                // A frame that was refused ends the wait early.
                Next::Timeout if left.is_zero() => return Ok(Code::Timeout),
                Next::Timeout => (),
                Next::Stopping => return Ok(Code::Stopping),
            }
        }
    }

    fn checked(&mut self, message: &Message<Object>) -> Result<Frame, Failure> {
        let (header, objects) = (*message.header(), message.elements().to_vec());
        let classes = self.run().map_or(0, |run| run.classes_count as usize);
        Object::checked(&header, &objects, classes)?;
        self.newest = self.object_points.newest()?.or(self.newest.take());
        let key = |header: &FrameHeader| (header.run_id, header.sequence);
        let own = (self.newest.as_ref()).filter(|own| key(own.header()) == key(&header));
        let mut indices = own.map_or(vec![], |own| own.elements().to_vec());
        let points = self.points(header.sequence).len();
        let sound = Object::checked_points(&header, &indices, points);
        if points == 0 || sound.is_err() || Object::checked_ranges(&objects, indices.len()).is_err()
        {
            indices.clear();
        }
        Ok(Frame { header, objects, indices })
    }

    pub(crate) fn run(&self) -> Option<&RunDescription> {
        self.shell.run()
    }

    /// The points of a frame in shared memory; empty: they are gone.
    pub(crate) fn points(&self, sequence: u64) -> &[Point] {
        self.frames.points(sequence).unwrap_or_default()
    }
}
