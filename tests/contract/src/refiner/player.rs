//! Plays ingest, backbone and head, and reads what the refiner says.

use std::time::{Duration, Instant};

use anyhow::Context;
use bytemuck::Zeroable;
use mluc_ipc_types::{
    DETECTIONS_MAX, Detection, FrameHeader, Health, Object, POINTS_MAX, Point, RunDescription,
    Stage, Text, Topic, WIRE_VERSION,
};
use mluc_runtime::{HealthWatch, Input, Instance, Output, Shell, monotonic_ns, random_run_id};

use crate::refiner::frame::{Answer, Frame, Sent};
use crate::refiner::session::Options;

/// Room for messages that break the contract: longer than its bounds.
const TOO_MANY_DETECTIONS: usize = DETECTIONS_MAX + 88;
const TOO_MANY_POINTS: usize = POINTS_MAX + 1000;
/// How often a wait looks around.
const LOOK: Duration = Duration::from_millis(20);

/// The ports of the stages before and behind the refiner.
pub(crate) struct Player {
    // Ports go before the shell.
    points: Output<Point>,
    detections: Output<Detection>,
    objects: Input<Object>,
    object_points: Input<u32>,
    health: HealthWatch,
    shell: Shell,
    next_sequence: u64,
    run: RunDescription,
}

impl Player {
    pub(crate) fn new(instance: &Instance, options: &Options) -> anyhow::Result<Player> {
        let shutdown = options.shutdown.clone();
        let mut shell = Shell::observer(instance, Some("refiner-test"), shutdown)?;
        let wide = |topic: Topic, elements_max: usize| Topic {
            elements_max,
            ..topic
        };
        let mut run = RunDescription {
            wire_version: WIRE_VERSION,
            classes_count: options.classes.len() as u32,
            model_fingerprint: options.fingerprint,
            model_name: Text::pack(&options.model),
            ..RunDescription::zeroed()
        };
        for (packed, name) in run.class_names.iter_mut().zip(&options.classes) {
            *packed = Text::pack(name);
        }
        let mut player = Player {
            points: shell.output(&wide(Topic::POINTS, TOO_MANY_POINTS), TOO_MANY_POINTS)?,
            detections: shell.output(
                &wide(Topic::DETECTIONS, TOO_MANY_DETECTIONS),
                TOO_MANY_DETECTIONS,
            )?,
            objects: shell.input(&Topic::OBJECTS)?,
            object_points: shell.side_input(&Topic::OBJECT_POINTS)?,
            health: shell.health_watch()?,
            shell,
            next_sequence: 0,
            run,
        };
        player.begin_run()?;
        Ok(player)
    }

    /// Describes a new run, whose sequences begin at 0; gives its id.
    pub(crate) fn begin_run(&mut self) -> anyhow::Result<u64> {
        self.run.run_id = random_run_id();
        self.next_sequence = 0;
        let is_ours = self.shell.begin_run(&self.run)?;
        anyhow::ensure!(
            is_ours,
            "another process describes the run of this instance"
        );
        Ok(self.run.run_id)
    }

    /// Of the run that the suite plays.
    pub(crate) fn run_id(&self) -> u64 {
        self.run.run_id
    }

    /// A frame with the next sequence and a header as the stages before leave it.
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
        Frame {
            points_header: Some(header),
            header,
            points,
            detections,
        }
    }

    /// Of the next frame.
    pub(crate) fn next_sequence(&self) -> u64 {
        self.next_sequence
    }

    /// Sends the points alone.
    pub(crate) fn send_points(&mut self, frame: &Frame) -> anyhow::Result<()> {
        if let Some(mut header) = frame.points_header {
            stamp(&mut header, Stage::Ingest);
            let mut loan = self.points.loan(&header, frame.points.len())?;
            loan.elements_mut().copy_from_slice(&frame.points);
            loan.publish()?;
        }
        Ok(())
    }

    /// Sends the points, then the detections.
    pub(crate) fn send(&mut self, frame: &Frame) -> anyhow::Result<Sent> {
        let mut header = frame.header;
        if frame.points_header.is_some() {
            stamp(&mut header, Stage::Ingest);
        }
        self.send_points(frame)?;
        let mut loan = self.detections.loan(&header, frame.detections.len())?;
        loan.elements_mut().copy_from_slice(&frame.detections);
        stamp(&mut header, Stage::Backbone);
        stamp(&mut header, Stage::Head);
        *loan.header_mut() = header;
        loan.publish()?;
        Ok(Sent {
            header,
            points: frame.points_header.map_or(0, |_| frame.points.len()),
            detections: frame.detections.clone(),
        })
    }

    /// The oldest answer that waits.
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

    /// Takes and forgets all answers.
    pub(crate) fn forget_answers(&mut self) -> anyhow::Result<()> {
        while self.take_answer()?.is_some() {}
        Ok(())
    }

    /// Sleeps until objects may have come, at most a moment.
    pub(crate) fn wait(&self) {
        self.objects.wait(LOOK);
    }

    /// Fails when this process was asked to end.
    pub(crate) fn check_running(&self) -> anyhow::Result<()> {
        anyhow::ensure!(!self.shell.is_stopping(), "the suite was interrupted");
        Ok(())
    }

    /// The refiner's last heartbeat, and how long ago it came.
    pub(crate) fn health(&mut self) -> anyhow::Result<Option<(Health, Duration)>> {
        // A refiner that started meanwhile gets the description of the run.
        self.shell.tick()?;
        self.health.update().context("reading heartbeats")?;
        let Some(health) = self.health.of(Stage::Refiner) else {
            return Ok(None);
        };
        let ago_ns = monotonic_ns().saturating_sub(self.health.heard_ns(Stage::Refiner));
        Ok(Some((*health, Duration::from_nanos(ago_ns))))
    }

    /// Lets go the heartbeats that were sent before now; gives the time after which one is fresh.
    pub(crate) fn forget_heartbeats(&mut self) -> anyhow::Result<u64> {
        self.health()?;
        Ok(monotonic_ns())
    }

    /// The last heartbeat, if it came after `since_ns` and fulfils `wanted`.
    pub(crate) fn health_since(
        &mut self,
        since_ns: u64,
        wanted: impl Fn(&Health) -> bool,
    ) -> anyhow::Result<Option<Health>> {
        let heard = self.health()?.map(|(health, _)| health);
        let is_fresh = self.health.heard_ns(Stage::Refiner) > since_ns;
        Ok(heard.filter(|health| is_fresh && wanted(health)))
    }

    /// Waits for a heartbeat from now on that fulfils `wanted`.
    pub(crate) fn await_health(
        &mut self,
        patience: Duration,
        wanted: impl Fn(&Health) -> bool,
    ) -> anyhow::Result<Option<Health>> {
        let since_ns = self.forget_heartbeats()?;
        let begun = Instant::now();
        while begun.elapsed() < patience {
            self.check_running()?;
            if let Some(health) = self.health_since(since_ns, &wanted)? {
                return Ok(Some(health));
            }
            std::thread::sleep(LOOK / 4);
        }
        Ok(None)
    }
}

/// A stage's three stamps, all of this moment.
fn stamp(header: &mut FrameHeader, stage: Stage) {
    let now_ns = monotonic_ns();
    let stamps = header.stamps_mut(stage);
    (stamps.received_ns, stamps.started_ns) = (now_ns, now_ns);
    stamps.published_ns = now_ns;
}
