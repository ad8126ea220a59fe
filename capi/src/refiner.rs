//! A refiner's process, without the refining.

use crate::error::{Code, Failure};
use mluc_ipc_types::{
    ContractError, Detection, Flags, FrameHeader, HealthState, OBJECT_POINTS_MAX, OBJECTS_MAX,
    Object, Point, RunDescription, Stage, Topic,
};
use mluc_runtime::{
    Frames, Instance, Message, Next, Output, RuntimeError, Scans, Shell, Shutdown, finish,
    log_to_stderr, monotonic_ns, stamp_published,
};
use std::time::Duration;

/// Ports, health and the frame in work.
pub(crate) struct Refiner {
    // Ports and messages are dropped before the shell.
    frame: Option<Frame>,
    frames: Frames<Detection>,
    objects: Output<Object>,
    object_points: Output<u32>,
    shell: Shell,
}

/// A frame whose detections were checked.
struct Frame {
    header: FrameHeader,
    detections: Message<Detection>,
    has_points: bool,
}

impl Refiner {
    /// Joins the instance that the environment names, as its refiner.
    pub(crate) fn open() -> Result<Refiner, RuntimeError> {
        log_to_stderr("refiner", "info");
        let instance = Instance::from_environment()?;
        let mut shell = Shell::stage(&instance, Stage::Refiner, Shutdown::on_signals()?)?;
        let objects = shell.output(&Topic::OBJECTS, OBJECTS_MAX)?;
        let object_points = shell.output(&Topic::OBJECT_POINTS, OBJECT_POINTS_MAX)?;
        let scans = Scans::open(&shell, true)?;
        let frames = Frames::new(&shell, &Topic::DETECTIONS, Some(scans))?;
        Ok(Refiner { frame: None, frames, objects, object_points, shell })
    }

    /// Waits for the newest frame that keeps the contract; others are refused and counted. [`Code::Ok`]: it came.
    pub(crate) fn wait(&mut self, timeout: Duration) -> Result<Code, Failure> {
        if self.frame.take().is_some() {
            self.frames.release();
        }
        self.shell.note_frame(None);
        // Before its first wait a program may load something for longer than a stage may be silent.
        if self.shell.health.state == HealthState::Starting as u32 {
            let reason = "waiting for detections";
            self.shell.state(HealthState::WaitingInput, reason)?;
        }
        let begun_ns = monotonic_ns();
        loop {
            let spent = Duration::from_nanos(monotonic_ns() - begun_ns);
            let left = timeout.saturating_sub(spent);
            let detections = match self.frames.next_within(&mut self.shell, |_, _| (), left)? {
                Next::Message(message) => message,
                // A frame that was refused ends the wait early.
                Next::Timeout if left.is_zero() => return Ok(Code::Timeout),
                Next::Timeout => continue,
                Next::Stopping => return Ok(Code::Stopping),
            };
            let mut header = *detections.header();
            if let Err(error) = Detection::checked(&header, detections.elements(), self.classes()) {
                self.shell.refuse(&error.to_string())?;
                self.frames.release();
                continue;
            }
            let has_points = self.frames.points(header.sequence).is_some();
            if !has_points {
                header.flag(Flags::POINTS_GONE.with(Flags::DEGRADED));
            }
            let stamps = header.stamps_mut(Stage::Refiner);
            (stamps.received_ns, stamps.started_ns) = (detections.received_ns, monotonic_ns());
            // A scan that kills the program twice is set aside.
            self.shell.note_frame(Some(header.sequence));
            self.frame = Some(Frame { header, detections, has_points });
            return Ok(Code::Ok);
        }
    }

    fn classes(&self) -> usize {
        self.shell.run().map_or(0, |run| run.classes_count as usize)
    }

    /// The frame in work: its header, run, points and detections, where they lie in shared memory.
    pub(crate) fn frame(&self) -> Option<(&FrameHeader, &RunDescription, &[Point], &[Detection])> {
        let frame = self.frame.as_ref()?;
        let points = self.frames.points(frame.header.sequence);
        let points = points.filter(|_| frame.has_points).unwrap_or_default();
        let (run, detections) = (self.shell.run()?, frame.detections.elements());
        Some((&frame.header, run, points, detections))
    }

    /// Publishes the frame's objects; `indices` point into its points. Nothing is published when they break the contract.
    pub(crate) fn publish(
        &mut self,
        objects: &[Object],
        indices: &[u32],
        flags: Flags,
    ) -> Result<(), Failure> {
        let Some((header, _, points, detections)) = self.frame() else {
            let words = "publish: there is no frame; wait gives one, and it is published once";
            return Err(Failure::new(Code::Usage, words));
        };
        Object::checked(header, objects, self.classes())?;
        if objects.len() < detections.len() {
            let what = "objects (one for each detection, suppressed ones too)";
            let [expected, found] = [detections.len(), objects.len()].map(|count| count as u64);
            return Err(ContractError::Mismatch(what, expected, found).into());
        }
        Object::checked_points(header, indices, points.len())?;
        Object::checked_ranges(objects, indices.len())?;
        let mut header = *header;
        let bytes_read = (size_of_val(points) + size_of_val(detections)) as u64;
        header.flag(flags);
        // The indices go first: a consumer that has the objects can then find their points.
        stamp_published(Stage::Refiner, &mut header);
        self.object_points.send(&header, indices)?;
        let mut loan = self.objects.loan(&header, objects.len())?;
        loan.elements_mut().copy_from_slice(objects);
        stamp_published(Stage::Refiner, loan.header_mut());
        loan.publish()?;
        self.frame = None;
        self.shell.note_frame(None);
        self.frames.release();
        let counters = &mut self.shell.health;
        counters.frames_in += 1;
        counters.candidates.add(objects);
        counters.bytes_read = bytes_read;
        counters.bytes_written = (size_of_val(objects) + size_of_val(indices)) as u32;
        Ok(finish(&mut self.shell, Stage::Refiner, &header)?)
    }
}

impl Drop for Refiner {
    /// Ingest sends it no more frames, and the supervisor does not take it for one that hangs.
    fn drop(&mut self) {
        let _ = self.shell.state(HealthState::Stopping, "");
    }
}
