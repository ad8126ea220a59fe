//! Plays a pipeline: a supervisor that describes the run, and a refiner's results with their scans.

use crate::{program::Options, suite::begin_run, suite::stamp};
use bytemuck::Zeroable;
use mluc_ipc_types::{
    Disposition, FrameHeader, NO_PROBABILITY, OBJECTS_MAX, Object, ObjectKind, POINTS_MAX, Point,
    RunDescription, Stage, Status, StatusState, Topic, WIRE_VERSION,
};
use mluc_runtime::{Instance, Output, Shell, monotonic_ns};

/// Room for messages that break the contract because they are longer than its bounds.
const TOO_MANY_OBJECTS: usize = OBJECTS_MAX + 88;
const POINTS: usize = 1000;

/// A frame to be sent.
pub(super) struct Frame {
    pub(super) header: FrameHeader,
    /// `None`: the scan is not sent.
    pub(super) points: Option<Vec<Point>>,
    pub(super) objects: Vec<Object>,
    pub(super) indices: Vec<u32>,
}

impl Frame {
    /// The number of points of each published object.
    pub(super) fn published_points(&self) -> Vec<u64> {
        let published = self.objects.iter().filter(|o| o.is_published());
        let has_points = u64::from(self.points.is_some());
        published.map(|o| has_points * u64::from(o.points_count)).collect()
    }
}

fn object(kind: ObjectKind, points_first: u32, points_count: u32) -> Object {
    let mut footprint_m = [[0.0; 2]; 16];
    footprint_m[..3].copy_from_slice(&[[9.0, -1.0], [11.0, -1.0], [9.0, 1.0]]);
    Object {
        kind: kind as u32,
        suppressed_by: Object::NONE,
        track_id: Object::NONE,
        unknown_probability: NO_PROBABILITY,
        score: 0.5,
        center_m: [10.0, 0.0, -1.0],
        size_m: [2.0, 2.0, 1.5],
        points_first,
        points_count,
        footprint_count: 3,
        footprint_m,
        ..Object::zeroed()
    }
}

pub(crate) struct Player {
    // Fields are dropped in order: the ports must be dropped before the shell.
    points: Output<Point>,
    objects: Output<Object>,
    object_points: Output<u32>,
    statuses: Output<Status>,
    shell: Shell,
    pub(super) run: RunDescription,
    pub(super) next: u64,
}

impl Player {
    pub(super) fn new(instance: &Instance, options: &Options) -> anyhow::Result<Player> {
        let mut shell = Shell::observer(instance, Some("suite"), options.shutdown.clone())?;
        let objects = Topic { elements_max: TOO_MANY_OBJECTS, ..Topic::OBJECTS };
        let mut player = Player {
            points: shell.output(&Topic::POINTS, POINTS_MAX)?,
            objects: shell.output(&objects, TOO_MANY_OBJECTS)?,
            object_points: shell.output(&Topic::OBJECT_POINTS, POINTS)?,
            statuses: shell.output(&Topic::STATUS, 1)?,
            shell,
            run: options.run,
            next: 0,
        };
        player.begin_run()?;
        Ok(player)
    }

    pub(super) fn begin_run(&mut self) -> anyhow::Result<()> {
        self.next = 0;
        begin_run(&mut self.shell, &mut self.run)
    }

    fn header(&self, sequence: u64) -> FrameHeader {
        let mut header = FrameHeader::new(sequence, "suite");
        header.run_id = self.run.run_id;
        header.model_fingerprint = self.run.model_fingerprint;
        for stage in Stage::ALL {
            stamp(&mut header, stage);
        }
        header
    }

    /// The next frame: a known object, an object that it suppresses, and an unknown one.
    pub(super) fn frame(&self) -> Frame {
        let known = object(ObjectKind::Known, 0, 30);
        let suppressed = Object {
            disposition: Disposition::OverlapsKnown as u32,
            suppressed_by: 0,
            ..object(ObjectKind::Unknown, 30, 0)
        };
        let unknown = object(ObjectKind::Unknown, 30, 12);
        let point = |number: usize| Point {
            x_m: 10.0,
            z_m: number as f32 * 1e-3 - 1.5,
            ..Point::default()
        };
        Frame {
            header: self.header(self.next),
            points: Some((0..POINTS).map(point).collect()),
            objects: vec![known, suppressed, unknown],
            indices: (0..42).collect(),
        }
    }

    pub(super) fn send_scan(&mut self, points: &[Point]) -> anyhow::Result<()> {
        let header = self.header(self.next);
        self.next += 1;
        Ok(self.points.send(&header, points)?)
    }

    /// Sends a frame in the pipeline's order: its scan, its status, the points of its objects, its objects.
    pub(super) fn send(&mut self, frame: &Frame) -> anyhow::Result<()> {
        if let Some(points) = &frame.points {
            self.send_scan(points)?;
        }
        let status = Status {
            wire_version: WIRE_VERSION,
            state: StatusState::Running as u32,
            run_id: self.run.run_id,
            judged_ns: monotonic_ns(),
            sequence: self.next - 1,
            frames_in: self.next,
            frames_out: self.next,
            ..Status::default()
        };
        self.statuses.send(&self.header(0), &[status])?;
        self.object_points.send(&frame.header, &frame.indices)?;
        self.objects.send(&frame.header, &frame.objects)?;
        Ok(self.shell.tick()?)
    }

    /// The number of consumers on `points`, `objects` and `object_points`.
    pub(super) fn consumers(&self) -> [usize; 3] {
        let (points, objects) = (self.points.consumers(), self.objects.consumers());
        [points, objects, self.object_points.consumers()]
    }
}
