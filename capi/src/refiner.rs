//! A refiner's process, without the refining.

use std::time::Duration;

use mluc_ipc_types::{
    CLASSES_MAX, ContractError, Detection, Flags, FrameHeader, HealthState, OBJECT_POINTS_MAX,
    OBJECTS_MAX, Object, Point, Stage, Topic,
};
use mluc_runtime::{
    Input, Message, Next, Output, Scans, Shell, ShellOptions, Shutdown, StageEnvironment,
    log_to_stderr, monotonic_ns,
};

use crate::error::Failure;

/// Ports, health and the frame in work.
pub(crate) struct Refiner {
    // Ports and messages go before the shell.
    frame: Option<Frame>,
    input: Input<Detection>,
    scans: Scans,
    objects: Output<Object>,
    object_points: Output<u32>,
    shell: Shell,
    classes: usize,
    fingerprint: u64,
}

/// A frame whose detections were checked.
pub(crate) struct Frame {
    pub(crate) header: FrameHeader,
    detections: Message<Detection>,
    has_points: bool,
}

/// How a wait ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Waited {
    Frame,
    Timeout,
    Stopping,
}

impl Refiner {
    /// Joins the instance that the environment names, as its refiner.
    pub(crate) fn open() -> Result<Refiner, Failure> {
        log_to_stderr("refiner", "info");
        let environment = StageEnvironment::read().map_err(Failure::open)?;
        let shutdown = Shutdown::on_signals().map_err(Failure::open)?;
        let options = ShellOptions::new(environment.instance);
        let mut shell = Shell::stage(options, Stage::Refiner, shutdown).map_err(Failure::open)?;
        let objects = shell.output(&Topic::OBJECTS, OBJECTS_MAX);
        let object_points = shell.output(&Topic::OBJECT_POINTS, OBJECT_POINTS_MAX);
        let refiner = Refiner {
            frame: None,
            input: shell.input(&Topic::DETECTIONS).map_err(Failure::open)?,
            scans: Scans::new(shell.side_input(&Topic::POINTS).map_err(Failure::open)?),
            objects: objects.map_err(Failure::open)?,
            object_points: object_points.map_err(Failure::open)?,
            shell,
            classes: match environment.classes.len() {
                0 => CLASSES_MAX,
                count => count,
            },
            fingerprint: environment.fingerprint,
        };
        refiner.begun()
    }

    fn begun(mut self) -> Result<Refiner, Failure> {
        self.shell
            .state(HealthState::WaitingInput, "waiting for detections")?;
        Ok(self)
    }

    /// Waits for the newest frame that keeps the contract; others are refused and counted.
    pub(crate) fn wait(&mut self, timeout: Duration) -> Result<Waited, Failure> {
        self.let_go();
        let begun_ns = monotonic_ns();
        loop {
            let spent = Duration::from_nanos(monotonic_ns() - begun_ns);
            let left = timeout.saturating_sub(spent);
            let scans = &mut self.scans;
            let next = self.shell.next_within(
                &mut self.input,
                &Topic::DETECTIONS,
                || scans.take(),
                left,
            )?;
            let message = match next {
                Next::Message(message) => message,
                Next::Timeout => return Ok(Waited::Timeout),
                Next::Stopping => {
                    self.shell.state(HealthState::Stopping, "")?;
                    return Ok(Waited::Stopping);
                }
            };
            let mut header = *message.header();
            header.stamps_mut(Stage::Refiner).received_ns = message.received_ns;
            match self.check(&header, &message) {
                Ok(()) => {
                    self.accept(header, message)?;
                    return Ok(Waited::Frame);
                }
                Err(error) => self.shell.refuse(&error.to_string())?,
            }
        }
    }

    fn check(
        &self,
        header: &FrameHeader,
        message: &Message<Detection>,
    ) -> Result<(), ContractError> {
        Detection::checked(header, message.elements(), self.classes)?;
        let pair = (self.fingerprint, header.model_fingerprint);
        match pair {
            (0, _) | (_, 0) => Ok(()),
            (own, found) if own == found => Ok(()),
            (expected, found) => Err(ContractError::Mismatch {
                what: "fingerprint of the model (all stages must run the same model)",
                expected,
                found,
            }),
        }
    }

    fn accept(
        &mut self,
        mut header: FrameHeader,
        detections: Message<Detection>,
    ) -> Result<(), Failure> {
        self.scans.take()?;
        let scan = self.scans.of(header.sequence);
        let has_points =
            scan.is_some_and(|scan| Point::checked(scan.header(), scan.elements()).is_ok());
        if !has_points {
            header.flag(Flags::POINTS_GONE.with(Flags::DEGRADED));
        }
        header.stamps_mut(Stage::Refiner).started_ns = monotonic_ns();
        self.frame = Some(Frame {
            header,
            detections,
            has_points,
        });
        Ok(())
    }

    /// The frame in work: its header, points and detections, where they lie in shared memory.
    pub(crate) fn frame(&self) -> Option<(&FrameHeader, &[Point], &[Detection])> {
        let frame = self.frame.as_ref()?;
        let points = match (frame.has_points, self.scans.of(frame.header.sequence)) {
            (true, Some(scan)) => scan.elements(),
            _ => &[],
        };
        Some((&frame.header, points, frame.detections.elements()))
    }

    /// Publishes the frame's objects; `indices` point into its points. Nothing is published when they break the contract.
    pub(crate) fn publish(
        &mut self,
        objects: &[Object],
        indices: &[u32],
        flags: Flags,
    ) -> Result<(), Failure> {
        let Some((header, points, detections)) = self.frame() else {
            return Err(Failure::usage(
                "publish: there is no frame; wait gives one, and it is published once",
            ));
        };
        Object::checked(header, objects, self.classes)?;
        if objects.len() < detections.len() {
            return Err(Failure::from(ContractError::Mismatch {
                what: "objects (one for each detection, suppressed ones too)",
                expected: detections.len() as u64,
                found: objects.len() as u64,
            }));
        }
        Object::checked_points(header, indices, points.len())?;
        if let Some(index) = objects.iter().position(|object| {
            u64::from(object.points_first) + u64::from(object.points_count) > indices.len() as u64
        }) {
            return Err(Failure::from(ContractError::Index {
                what: "range of an object's points",
                len: indices.len(),
                found: index,
            }));
        }
        let mut header = *header;
        let bytes_read = (size_of_val(points) + size_of_val(detections)) as u64;
        header.flag(flags);
        // First the indices: whoever has the objects can ask for their points.
        let mut draft = self.object_points.draft(&header, indices.len())?;
        draft.elements_mut().copy_from_slice(indices);
        draft.header_mut().stamps_mut(Stage::Refiner).published_ns = monotonic_ns();
        draft.publish()?;
        let mut draft = self.objects.draft(&header, objects.len())?;
        draft.elements_mut().copy_from_slice(objects);
        draft.header_mut().stamps_mut(Stage::Refiner).published_ns = monotonic_ns();
        draft.publish()?;
        self.let_go();
        self.scans.let_go();
        let counters = &mut self.shell.counters;
        counters.frames_in += 1;
        counters.frames_out += 1;
        counters.candidates.add(objects);
        counters.bytes_read = bytes_read;
        counters.bytes_written = (size_of_val(objects) + size_of_val(indices)) as u64;
        let started_ns = header.stages[Stage::Refiner as usize].started_ns;
        self.shell
            .record_run(monotonic_ns().saturating_sub(started_ns));
        self.shell.state(HealthState::Running, "")?;
        Ok(self.shell.tick()?)
    }

    fn let_go(&mut self) {
        self.frame = None;
        self.shell.counters.frames_dropped = self.input.dropped();
    }
}
