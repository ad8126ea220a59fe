//! Plays ingest, backbone and head, and reads the refiner's messages.

use crate::{program::Options, refiner::scene::usual, suite::begin_run, suite::stamp};
use anyhow::Context;
use mluc_ipc_types::{
    DETECTIONS_MAX, Detection, FrameHeader, Health, Object, POINTS_MAX, Point, RunDescription,
    Stage, Topic,
};
use mluc_runtime::{HealthWatch, Input, Instance, Output, Shell};

/// Room for messages that break the contract because they are longer than its bounds.
const TOO_MANY_DETECTIONS: usize = DETECTIONS_MAX + 88;
const TOO_MANY_POINTS: usize = POINTS_MAX + 1000;

/// A frame to be sent: its detections, and its points unless they must be missing.
pub(crate) struct Frame {
    /// Header of the detections' message.
    pub(crate) header: FrameHeader,
    /// Header of the points' message; `None`: the points are never sent.
    pub(crate) points_header: Option<FrameHeader>,
    pub(crate) points: Vec<Point>,
    pub(crate) detections: Vec<Detection>,
}

impl Frame {
    /// Number of points that a refiner can find for the detections.
    pub(crate) fn points_found(&self) -> usize {
        let of = |header: FrameHeader| (header.run_id, header.sequence);
        let is_its_own = self.points_header.map(of) == Some(of(self.header));
        if is_its_own { self.points.len() } else { 0 }
    }
}

pub(crate) struct Answer {
    pub(crate) header: FrameHeader,
    pub(crate) objects: Vec<Object>,
    /// The newest message of `object_points` when the objects came.
    pub(crate) indices: Option<(FrameHeader, Vec<u32>)>,
    /// CLOCK_MONOTONIC, ns.
    pub(crate) received_ns: u64,
}

impl Answer {
    /// Time since the detections were sent, ms.
    pub(crate) fn took_ms(&self, frame: &Frame) -> f64 {
        let begun_ns = frame.header.stages[Stage::Head as usize].published_ns;
        self.received_ns.saturating_sub(begun_ns) as f64 * 1e-6
    }
}

/// The ports of the stages before and behind the refiner.
pub(crate) struct Player {
    // Fields are dropped in order: the ports must be dropped before the shell.
    points: Output<Point>,
    detections: Output<Detection>,
    pub(crate) objects: Input<Object>,
    object_points: Input<u32>,
    pub(crate) health: HealthWatch,
    shell: Shell,
    pub(crate) next_sequence: u64,
    run: RunDescription,
}

impl Player {
    pub(crate) fn new(instance: &Instance, options: &Options) -> anyhow::Result<Player> {
        let shutdown = options.shutdown.clone();
        let mut shell = Shell::observer(instance, Some("refiner-test"), shutdown)?;
        let wide = |topic: Topic, elements_max: usize| Topic { elements_max, ..topic };
        let points = wide(Topic::POINTS, TOO_MANY_POINTS);
        let detections = wide(Topic::DETECTIONS, TOO_MANY_DETECTIONS);
        let mut player = Player {
            points: shell.output(&points, points.elements_max)?,
            detections: shell.output(&detections, detections.elements_max)?,
            objects: shell.input(&Topic::OBJECTS)?,
            object_points: shell.side_input(&Topic::OBJECT_POINTS)?,
            health: shell.health_watch()?,
            shell,
            next_sequence: 0,
            run: options.run,
        };
        player.begin_run()?;
        Ok(player)
    }

    /// Describes a new run, whose sequences begin at 0; returns its id.
    pub(crate) fn begin_run(&mut self) -> anyhow::Result<u64> {
        self.next_sequence = 0;
        begin_run(&mut self.shell, &mut self.run)?;
        Ok(self.run.run_id)
    }

    /// A frame with the next sequence and the header that the stages before the refiner produce.
    pub(crate) fn frame(&mut self, points: Vec<Point>, detections: Vec<Detection>) -> Frame {
        let sequence = self.next_sequence;
        self.next_sequence += 1;
        let mut header = FrameHeader::new(sequence, &format!("suite-{sequence:06}"));
        header.sensor_stamp_ns = 1_700_000_000_000_000_000 + sequence * 100_000_000;
        header.sensor_id = 7;
        header.points_in = points.len() as u32;
        header.feature_rows = 1234;
        header.feature_channels = 128;
        header.run_id = self.run.run_id;
        header.model_fingerprint = self.run.model_fingerprint;
        header.ego.position_m = [sequence as f64, 2.0, 3.0];
        header.ego.is_known = 1;
        Frame { points_header: Some(header), header, points, detections }
    }

    /// The next frame, with the scene of most cases.
    pub(crate) fn usual(&mut self) -> Frame {
        let (points, detections) = usual();
        self.frame(points, detections)
    }

    pub(crate) fn send_points(&mut self, frame: &Frame) -> anyhow::Result<()> {
        if let Some(mut header) = frame.points_header {
            stamp(&mut header, Stage::Ingest);
            self.points.send(&header, &frame.points)?;
        }
        Ok(())
    }

    /// Sends the points, then the detections, whose header gets the stamps of the earlier stages.
    pub(crate) fn send(&mut self, frame: &mut Frame) -> anyhow::Result<()> {
        self.send_points(frame)?;
        let header = &mut frame.header;
        let mut loan = self.detections.loan(header, frame.detections.len())?;
        loan.elements_mut().copy_from_slice(&frame.detections);
        if frame.points_header.is_some() {
            stamp(header, Stage::Ingest);
        }
        stamp(header, Stage::Backbone);
        stamp(header, Stage::Head);
        *loan.header_mut() = *header;
        Ok(loan.publish()?)
    }

    /// The oldest waiting answer.
    pub(crate) fn take_answer(&mut self) -> anyhow::Result<Option<Answer>> {
        let Some(message) = self.objects.oldest()? else {
            return Ok(None);
        };
        let indices = self.object_points.newest()?;
        Ok(Some(Answer {
            header: *message.header(),
            objects: message.elements().to_vec(),
            indices: indices.map(|m| (*m.header(), m.elements().to_vec())),
            received_ns: message.received_ns,
        }))
    }

    /// The answer to a frame, if it is waiting; answers to earlier frames are skipped.
    pub(crate) fn take_answer_to(&mut self, sequence: u64) -> anyhow::Result<Option<Answer>> {
        while let Some(answer) = self.take_answer()? {
            if answer.header.sequence == sequence {
                return Ok(Some(answer));
            }
        }
        Ok(None)
    }

    pub(crate) fn forget_answers(&mut self) -> anyhow::Result<()> {
        while self.take_answer()?.is_some() {}
        Ok(())
    }

    /// The time of the refiner's last heartbeat (CLOCK_MONOTONIC, ns); 0: none came.
    pub(crate) fn heard_ns(&mut self) -> anyhow::Result<u64> {
        // A refiner that has started meanwhile gets the description of the run.
        self.shell.tick()?;
        self.health.update().context("reading heartbeats")?;
        Ok(self.health.heard_ns(Stage::Refiner))
    }

    /// The refiner's last heartbeat, if it came after `since_ns`.
    pub(crate) fn health_since(&mut self, since_ns: u64) -> anyhow::Result<Option<Health>> {
        let is_fresh = self.heard_ns()? > since_ns;
        Ok(self.health.of(Stage::Refiner).filter(|_| is_fresh).copied())
    }
}
