//! A pipeline as messages: each frame with its points and the states. Without a frame, the states come once a second.

use mluc_gateway::lines::{line, stage_words, status_words};
use mluc_gateway::ros2::{
    RosTopic, detections, diagnostics, header, markers, point_cloud, topics, transform,
};
use mluc_ipc_types::{Object, RunDescription, Stage, Status, Text, Topic, WIRE_VERSION};
use mluc_runtime::{
    Frames, HealthWatch, Input, Instance, Message, Next, Scans, Shell, Shutdown, StatusWatch,
    monotonic_ns, wall_clock_ns,
};
use serde_json::json;
use std::time::Duration;

/// Number of topics: those of [`topics`], and a last one for the line of a frame in JSON.
pub const TOPICS: usize = 6;
/// Frame of reference if the sensor has no name.
const SENSOR_FRAME: &str = "lidar";
const WAIT: Duration = Duration::from_secs(1);
/// Nice value: the stages have a higher priority.
const NICE: i32 = 10;

/// One message per topic, in CDR, the last one in JSON. `None`: no message, for example without a frame or if its points are gone.
pub type Messages = [Option<Vec<u8>>; TOPICS];

/// All messages of one moment.
pub struct Moment {
    /// Time of the moment, ns since 1970.
    pub log_ns: u64,
    /// Sequence number of the frame; `None`: there are only the states.
    pub sequence: Option<u64>,
    /// The messages by topic.
    pub messages: Messages,
}

/// Observes a pipeline whenever one runs.
pub struct Follower {
    // Drop order: the ports before the shell.
    frames: Frames<Object>,
    object_points: Input<u32>,
    /// The newest message of `object_points`.
    indices: Option<Message<u32>>,
    health: HealthWatch,
    status: StatusWatch,
    /// The connection to the instance. It counts the missed frames.
    pub shell: Shell,
    topics: [RosTopic; TOPICS - 1],
}

/// Lowers the priority of this thread and of the threads that it starts below the stages. A second call changes nothing.
pub fn yield_to_stages() -> anyhow::Result<()> {
    let now = rustix::process::nice(0)?;
    rustix::process::nice((NICE - now).max(0))?;
    Ok(())
}

impl Follower {
    /// Joins the instance `named`, else the one of the environment; the pipeline may start later. Lowers this process's priority below the stages.
    pub fn open(named: Option<Instance>) -> anyhow::Result<Follower> {
        let instance = named.map_or_else(Instance::from_environment, Ok)?;
        yield_to_stages()?;
        let shell = Shell::observer(&instance, None, Shutdown::on_signals()?)?;
        Ok(Follower {
            frames: Frames::new(&shell, &Topic::OBJECTS, Some(Scans::open(&shell, true)?))?,
            object_points: shell.side_input(&Topic::OBJECT_POINTS)?,
            indices: None,
            health: shell.health_watch()?,
            status: shell.status_watch()?,
            shell,
            topics: topics(),
        })
    }

    /// Waits up to 1 s for the newest frame, which is encoded only if somebody `listens`. `None`: this process was asked to end.
    pub fn next(&mut self, listens: impl Fn() -> bool) -> anyhow::Result<Option<Moment>> {
        let next = self.frames.next_within(&mut self.shell, |_, _| (), WAIT)?;
        let mut moment =
            Moment { log_ns: wall_clock_ns(), sequence: None, messages: Messages::default() };
        let (run, status) = (self.shell.run().copied(), self.status.update()?);
        match (next, run) {
            (Next::Stopping, _) => return Ok(None),
            (Next::Message(message), Some(run)) if listens() => {
                self.indices = self.object_points.newest()?.or(self.indices.take());
                match self.tell(&message, &run, status.as_ref()) {
                    Ok(messages) => moment.messages = messages,
                    Err(error) => self.shell.refuse(&error.to_string())?,
                }
                moment.sequence = Some(message.header().sequence);
            }
            _ => (),
        }
        // Without a frame nothing is finished: the frame under way needs its scan.
        if moment.sequence.is_some() {
            self.frames.release();
        }
        moment.messages[3] = Some(self.states(moment.log_ns, status.as_ref())?);
        Ok(Some(moment))
    }

    /// All messages of a frame except the states. Errors: why its objects are not valid.
    fn tell(
        &self,
        message: &Message<Object>,
        run: &RunDescription,
        status: Option<&Status>,
    ) -> anyhow::Result<Messages> {
        let (frame, topics) = (message.header(), &self.topics);
        let classes: Vec<String> = run.class_names().map(str::to_string).collect();
        // A copy, because shared memory may change after the check.
        let objects = message.elements().to_vec();
        let objects = Object::checked(frame, &objects, classes.len())?;
        let key = |message: &Message<u32>| (message.header().run_id, message.header().sequence);
        let own = (self.indices.as_ref()).filter(|own| key(own) == (frame.run_id, frame.sequence));
        let indices = own.map_or(&[][..], Message::elements);
        let sensor = Text::unpack(&run.sensor_name).filter(|name| !name.is_empty());
        let head = header(frame.sensor_stamp_ns, sensor.unwrap_or(SENSOR_FRAME));
        let starting =
            Status { wire_version: WIRE_VERSION, run_id: frame.run_id, ..Status::default() };
        // The supervisor may judge the frame later.
        let status = Status {
            age_ns: monotonic_ns().saturating_sub(frame.stages[0].received_ns),
            ..*status.unwrap_or(&starting)
        };
        let line = line(frame, objects, &classes, &status);
        let points = self.frames.points(frame.sequence);
        Ok([
            points.map(|points| point_cloud(&topics[0], &head, points, objects, indices)),
            Some(topics[1].encode(&detections(&head, objects, &classes))),
            Some(topics[2].encode(&markers(&head, objects, &classes))),
            None,
            // All zeros: no pose is set. Publishing it would replace the robot's own transform.
            (run.base_from_sensor != [0.0; 6])
                .then(|| topics[4].encode(&transform(&head, run.base_from_sensor))),
            Some(serde_json::to_vec(&line)?),
        ])
    }

    fn states(&mut self, now_ns: u64, status: Option<&Status>) -> anyhow::Result<Vec<u8>> {
        self.health.update()?;
        let none = json!({"state": "unknown", "reason": "no supervisor publishes a status"});
        let mut parts = vec![("pipeline", status.map_or(none, status_words))];
        let heard = self.health.heard();
        for (stage, health) in Stage::ALL.into_iter().zip(&heard) {
            parts.push((stage.name(), stage_words(stage, health.as_ref())));
        }
        let (head, instance) = (header(now_ns, ""), self.shell.instance().name());
        Ok(self.topics[3].encode(&diagnostics(&head, instance, &parts)))
    }
}
