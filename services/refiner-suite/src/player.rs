//! Plays ingest, backbone and head, and reads what the refiner says.

use std::time::{Duration, Instant};

use anyhow::Context;
use mluc_ipc_types::{
    DETECTIONS_MAX, Detection, FrameHeader, Health, Object, POINTS_MAX, Point, Stage, Topic,
};
use mluc_runtime::{
    HealthWatch, Input, Instance, Output, Shell, ShellOptions, Shutdown, monotonic_ns,
};

use crate::frame::{Answer, Frame, Sent};

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
    fingerprint: u64,
}

impl Player {
    pub(crate) fn new(
        instance: &Instance,
        fingerprint: u64,
        shutdown: Shutdown,
    ) -> anyhow::Result<Player> {
        let options = ShellOptions::new(instance.clone());
        let mut shell = Shell::observer(options, Some("refiner-test"), shutdown)?;
        let wide = |topic: Topic, elements_max: usize| Topic {
            elements_max,
            ..topic
        };
        Ok(Player {
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
            fingerprint,
        })
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
        header.model_fingerprint = self.fingerprint;
        header.ego.position_m = [sequence as f64, 2.0, 3.0];
        header.ego.is_known = 1;
        Frame {
            points_header: Some(header),
            header,
            points,
            detections,
        }
    }

    /// The next frames begin with this sequence.
    pub(crate) fn set_next_sequence(&mut self, sequence: u64) {
        self.next_sequence = sequence;
    }

    /// Sends the points, then the detections.
    pub(crate) fn send(&mut self, frame: &Frame) -> anyhow::Result<Sent> {
        let mut header = frame.header;
        if let Some(mut points_header) = frame.points_header {
            let now_ns = monotonic_ns();
            for header in [&mut header, &mut points_header] {
                let stamps = header.stamps_mut(Stage::Ingest);
                (stamps.received_ns, stamps.started_ns) = (now_ns, now_ns);
                stamps.published_ns = now_ns;
            }
            let mut draft = self.points.draft(&points_header, frame.points.len())?;
            draft.elements_mut().copy_from_slice(&frame.points);
            draft.publish()?;
        }
        let mut draft = self.detections.draft(&header, frame.detections.len())?;
        draft.elements_mut().copy_from_slice(&frame.detections);
        let now_ns = monotonic_ns();
        for stage in [Stage::Backbone, Stage::Head] {
            let stamps = header.stamps_mut(stage);
            (stamps.received_ns, stamps.started_ns) = (now_ns, now_ns);
            stamps.published_ns = now_ns;
        }
        *draft.header_mut() = header;
        draft.publish()?;
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
        self.shell.wait(&self.objects, LOOK);
    }

    /// Fails when this process was asked to end.
    pub(crate) fn check_running(&self) -> anyhow::Result<()> {
        match self.shell.is_stopping() {
            true => anyhow::bail!("the suite was interrupted"),
            false => Ok(()),
        }
    }

    /// The refiner's last heartbeat, and how long ago it came.
    pub(crate) fn health(&mut self) -> anyhow::Result<Option<(Health, Duration)>> {
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
