//! Plays the supervisor, backbone, head and refiner, and reads the source's messages.

use crate::{program::Options, suite::begin_run};
use anyhow::ensure;
use bytemuck::Zeroable;
use mluc_ipc_types::{
    Flags, FrameHeader, Health, HealthState, Point, RunDescription, Stage, Status, StatusState,
    Topic, WIRE_VERSION,
};
use mluc_runtime::{HealthWatch, Input, Instance, Output, RuntimeError, Shell, monotonic_ns};
use std::time::Duration;

/// Time between two status messages.
const PERIOD_NS: u64 = 100_000_000;

/// A scan that the source sent.
pub(super) struct Scan {
    pub(super) header: FrameHeader,
    points: Vec<Point>,
    received_ns: u64,
}

impl Scan {
    /// Checks whether this scan alone keeps the contract.
    pub(super) fn check(&self, run: &RunDescription, sequence: u64) -> anyhow::Result<()> {
        let Scan { header, points, .. } = self;
        header.checked_in(run, sequence..sequence + 1)?;
        Point::checked(header, points)?;
        let bad = points.iter().position(|point| !point.is_finite());
        ensure!(bad.is_none(), "points: expected finite numbers, found others in point {bad:?}");
        let (kept, left_out) = (points.len() as u64, header.points_dropped);
        let (expected, found) = (kept + u64::from(left_out), u64::from(header.points_in));
        ensure!(
            expected == found,
            "points_in: expected {expected} ({kept} and points_dropped {left_out}), found {found}"
        );
        let has = |flag: Flags| Flags(header.flags).contains(flag);
        let is_told = has(Flags::NOT_FINITE) || has(Flags::TRUNCATED);
        ensure!(
            is_told == (left_out > 0),
            "points_dropped is {left_out}, flags not_finite or truncated: {is_told}"
        );
        let (is_empty, is_said) = (points.is_empty(), has(Flags::EMPTY));
        ensure!(is_empty == is_said, "without points: {is_empty}, flag empty: {is_said}");
        let name = header.name();
        ensure!(!["", "?"].contains(&name), "name: expected text, found '{name}'");
        let own = header.stages[Stage::Ingest as usize];
        let stamps = [1, own.received_ns, own.started_ns, own.published_ns];
        ensure!(
            stamps.is_sorted() && own.published_ns <= self.received_ns,
            "stamps {own:?}: expected in order and before {} (CLOCK_MONOTONIC, ns)",
            self.received_ns
        );
        Ok(())
    }
}

/// The heartbeats of a stage.
fn beats(shell: &mut Shell, name: &'static str) -> Result<Output<Health>, RuntimeError> {
    let topic = Topic { name, ..Topic::HEALTH };
    shell.output(&topic, 1)
}

pub(crate) struct Player {
    // Fields are dropped in order: the ports must be dropped before the shell.
    points: Input<Point>,
    statuses: Output<Status>,
    pub(super) health: HealthWatch,
    /// Heartbeats of backbone, head and refiner, and whether these stages are present.
    beats: [Output<Health>; 3],
    pub(super) has_stages: bool,
    shell: Shell,
    pub(super) run: RunDescription,
    /// The supervisor's count of scans that came.
    pub(super) sent: u64,
    pub(super) answers: bool,
    told_ns: u64,
}

impl Player {
    pub(super) fn new(instance: &Instance, options: &Options) -> anyhow::Result<Player> {
        let mut shell = Shell::observer(instance, Some("suite"), options.shutdown.clone())?;
        let mut player = Player {
            points: shell.input(&Topic::POINTS)?,
            statuses: shell.output(&Topic::STATUS, 1)?,
            health: shell.health_watch()?,
            beats: [
                beats(&mut shell, "health/backbone")?,
                beats(&mut shell, "health/head")?,
                beats(&mut shell, "health/refiner")?,
            ],
            has_stages: false,
            shell,
            run: options.run,
            sent: 0,
            answers: false,
            told_ns: 0,
        };
        player.begin_run()?;
        Ok(player)
    }

    pub(super) fn begin_run(&mut self) -> anyhow::Result<()> {
        begin_run(&mut self.shell, &mut self.run)?;
        (self.sent, self.answers) = (0, false);
        while self.points.oldest()?.is_some() {}
        Ok(())
    }

    /// The continuous work of the played processes; takes 2 ms.
    pub(super) fn tick(&mut self) -> anyhow::Result<()> {
        self.shell.tick()?;
        self.health.update()?;
        let now_ns = monotonic_ns();
        if now_ns - self.told_ns > PERIOD_NS {
            self.told_ns = now_ns;
            let newest = self.sent.checked_sub(1).filter(|_| self.answers);
            let status = Status {
                wire_version: WIRE_VERSION,
                state: StatusState::Running as u32,
                run_id: self.run.run_id,
                judged_ns: now_ns,
                sequence: newest.unwrap_or(Status::NONE),
                age_ns: newest.map_or(Status::NONE, |_| 0),
                frames_in: self.sent,
                ..Status::default()
            };
            let mut header = FrameHeader::new(0, Topic::STATUS.name);
            header.run_id = self.run.run_id;
            self.statuses.send(&header, &[status])?;
            let stages = self.beats.iter_mut().zip(&Stage::ALL[1..]);
            for (output, stage) in stages.filter(|_| self.has_stages) {
                let health = Health {
                    wire_version: WIRE_VERSION,
                    stage: *stage as u32,
                    state: HealthState::WaitingInput as u32,
                    pid: std::process::id(),
                    run_id: self.run.run_id,
                    ..Health::zeroed()
                };
                output.send(&header, &[health])?;
            }
        }
        self.statuses.reach_late_readers()?;
        std::thread::sleep(Duration::from_millis(2));
        Ok(())
    }

    /// The oldest waiting scan.
    pub(super) fn take(&mut self) -> anyhow::Result<Option<Scan>> {
        let Some(message) = self.points.oldest()? else {
            return Ok(None);
        };
        let header = *message.header();
        if header.run_id == self.run.run_id {
            self.sent = self.sent.max(header.sequence.saturating_add(1));
        }
        Ok(Some(Scan {
            header,
            points: message.elements().to_vec(),
            received_ns: message.received_ns,
        }))
    }
}
