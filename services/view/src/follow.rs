//! A pipeline as messages: each frame with its points, and the states, once a second where no frame comes.

use std::time::Duration;

use mluc_gateway::lines::{line, stage_words, status_words};
use mluc_gateway::ros2::{
    RosTopic, detections, diagnostics, header, markers, point_cloud, topics, transform,
};
use mluc_ipc_types::{Object, RunDescription, Stage, Status, Text, Topic, WIRE_VERSION};
use mluc_runtime::{
    Frames, HealthWatch, Input, Instance, Message, Next, Scans, Shell, Shutdown, StatusWatch,
    wall_clock_ns,
};
use serde_json::json;

/// Those of [`topics`], and the last one: the line of a frame in JSON.
pub const TOPICS: usize = 6;
/// Frame of reference where the sensor has no name.
const SENSOR_FRAME: &str = "lidar";
const WAIT: Duration = Duration::from_secs(1);
/// The stages come first.
const NICE: i32 = 10;

/// In CDR by topic; `None`: there is no frame, or its points are gone.
pub type Messages = [Option<Vec<u8>>; TOPICS];

/// What there is to tell at one moment.
pub struct Moment {
    /// When, ns since 1970.
    pub log_ns: u64,
    /// Of a frame; `None`: the states alone.
    pub sequence: Option<u64>,
    /// What it says.
    pub messages: Messages,
}

/// Looks on at a pipeline, whenever there is one.
pub struct Follower {
    // The ports go before the shell.
    frames: Frames<Object>,
    object_points: Input<u32>,
    /// The newest.
    indices: Option<Message<u32>>,
    health: HealthWatch,
    status: StatusWatch,
    /// Counts the frames that it missed.
    pub shell: Shell,
    topics: [RosTopic; TOPICS - 1],
}

/// This thread, and those that it starts, yield to the stages from now on. A second call changes nothing.
pub fn yield_to_stages() -> anyhow::Result<()> {
    let now = rustix::process::nice(0)?;
    rustix::process::nice((NICE - now).max(0))?;
    Ok(())
}

impl Follower {
    /// Joins the instance that is `named`, else that of the environment; no pipeline need run yet. From now on this process yields to the stages.
    pub fn open(named: Option<Instance>) -> anyhow::Result<Follower> {
        let instance = named.map_or_else(Instance::from_environment, Ok)?;
        yield_to_stages()?;
        let shell = Shell::observer(&instance, None, Shutdown::on_signals()?)?;
        let mut status = shell.status_watch()?;
        // What waits in the queue may be the last word of a supervisor that is gone.
        status.update()?;
        Ok(Follower {
            frames: Frames::new(&shell, &Topic::OBJECTS, Some(Scans::open(&shell, true)?))?,
            object_points: shell.side_input(&Topic::OBJECT_POINTS)?,
            indices: None,
            health: shell.health_watch()?,
            status,
            shell,
            topics: topics(),
        })
    }

    /// Waits for the newest frame while somebody `listens`. `None`: this process was asked to end.
    pub fn next(&mut self, listens: impl Fn() -> bool) -> anyhow::Result<Option<Moment>> {
        let next = self.frames.next_within(&mut self.shell, |_, _| (), WAIT)?;
        let mut moment = Moment {
            log_ns: wall_clock_ns(),
            sequence: None,
            messages: Messages::default(),
        };
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
        self.frames.release();
        moment.messages[3] = Some(self.states(moment.log_ns, status.as_ref())?);
        Ok(Some(moment))
    }

    /// All of a frame but the states. Errors: what is wrong with its objects.
    fn tell(
        &self,
        message: &Message<Object>,
        run: &RunDescription,
        status: Option<&Status>,
    ) -> anyhow::Result<Messages> {
        let (frame, topics) = (message.header(), &self.topics);
        let classes: Vec<String> = run.class_names().map(str::to_string).collect();
        // A copy: what lies in shared memory may change after the check.
        let objects = message.elements().to_vec();
        let objects = Object::checked(frame, &objects, classes.len())?;
        let key = |message: &Message<u32>| (message.header().run_id, message.header().sequence);
        let own = (self.indices.as_ref()).filter(|own| key(own) == (frame.run_id, frame.sequence));
        let indices = own.map_or(&[][..], Message::elements);
        let sensor = Text::unpack(&run.sensor_name).filter(|name| !name.is_empty());
        let head = header(frame.sensor_stamp_ns, sensor.unwrap_or(SENSOR_FRAME));
        let starting = Status {
            wire_version: WIRE_VERSION,
            run_id: frame.run_id,
            age_ns: Status::NONE,
            ..Status::default()
        };
        let line = line(frame, objects, &classes, status.unwrap_or(&starting));
        let points = self.frames.points(frame.sequence);
        Ok([
            points.map(|points| point_cloud(&topics[0], &head, points, objects, indices)),
            Some(topics[1].encode(&detections(&head, objects, &classes))),
            Some(topics[2].encode(&markers(&head, objects, &classes))),
            None,
            // Without a pose of its own it would replace the robot's.
            (run.base_from_sensor != [0.0; 6])
                .then(|| topics[4].encode(&transform(&head, run.base_from_sensor))),
            Some(serde_json::to_vec(&line)?),
        ])
    }

    fn states(&mut self, now_ns: u64, status: Option<&Status>) -> anyhow::Result<Vec<u8>> {
        self.health.update()?;
        let none = json!({"state": "stopped", "reason": "no pipeline runs"});
        let mut parts = vec![("pipeline", status.map_or(none, status_words))];
        let heard = self.health.heard();
        for (stage, health) in Stage::ALL.into_iter().zip(&heard) {
            parts.push((stage.name(), stage_words(stage, health.as_ref())));
        }
        let (head, instance) = (header(now_ns, ""), self.shell.instance().name());
        Ok(self.topics[3].encode(&diagnostics(&head, instance, &parts)))
    }
}
