//! Scans from a ROS 2 topic. Only the newest cloud is used; skipped clouds are counted by the publisher's sequence numbers.

use crate::dds::{Encoded, Patience, anew, join, keep, topic};
use mluc::UsageError;
use mluc_gateway::ros2::topics;
use mluc_runtime::wall_clock_ns;
use mluc_sources::files::Layout;
use mluc_sources::{LiveScans, Next, ODOMETRY, Odometry, Scan, Source, TF, TRANSFORMS, ros2_topic};
use rustdds::{DomainParticipant, GUID, QosPolicyBuilder};
use rustdds::{no_key::SimpleDataReader, policy::Durability};
use std::thread::{Thread, current, park_timeout};
use std::time::{Duration, Instant};
use std::{path::Path, sync::Arc, task::Wake, task::Waker};

/// Clouds in the queue: the newest, and the one that arrives.
const CLOUDS_MAX: i32 = 2;
/// Poses in the queue: 0.2 s at 1 kHz.
const POSES_MAX: i32 = 200;
/// Messages of fixed transforms in the queue: one per publisher.
const FIXED_MAX: i32 = 50;
const ODOM: &str = "/odom";
/// The kernel's limit for a socket's buffer, and the size that a cloud of 200,000 points needs.
const BUFFER: &str = "/proc/sys/net/core/rmem_max";
const BUFFER_BYTES: u64 = 4 << 20;
/// How long a writer may wait for readers; nothing is written here.
const RELIABLE_BLOCKING: rustdds::Duration = rustdds::Duration::ZERO;

/// Opens an input as [`Source::open`] does, and also `ros2:/TOPIC`.
pub(crate) fn open(input: &Path, layout: &Layout, repeat: bool) -> anyhow::Result<Source> {
    match ros2_topic(input) {
        Some(name) => Source::live(Clouds::open(name, layout)?, layout),
        None => Source::open(input, layout, repeat),
    }
}

type Reader = SimpleDataReader<Vec<u8>, Encoded>;

struct Clouds {
    name: String,
    layout: Layout,
    /// None: joining the domain again failed.
    topics: Option<Topics>,
    /// The odometry that corrects the scans.
    odometry: Odometry,
    heard: Instant,
    /// The wall clock at the last look: where it was set back, the reader gives nothing until it has caught up.
    wall_ns: u64,
    patience: Patience,
    /// Publisher and sequence number of the last cloud.
    last: Option<(GUID, i64)>,
    /// Messages since the last scan that were lost, replaced or not readable.
    missed: u64,
}

/// The topics that are read.
struct Topics {
    clouds: Reader,
    /// Readers of poses: the reader, its message type, and whether its transforms are fixed (valid at any time). Empty without `--deskew`.
    poses: Vec<(Reader, &'static str, bool)>,
    participant: DomainParticipant,
}

impl Topics {
    fn join(name: &str, layout: &Layout) -> anyhow::Result<Topics> {
        let participant = join()?;
        let read = |qos, name: &str, schema: &str, depth, count_max| -> anyhow::Result<Reader> {
            let qos = keep(qos, depth, count_max);
            let topic = topic(&participant, name, schema, &qos)?;
            let subscriber = participant.create_subscriber(&qos)?;
            Ok(subscriber.create_simple_datareader_no_key(&topic, Some(qos))?)
        };
        // ROS QoS profiles: one for sensor data, one for messages that are sent once and that late subscribers receive too.
        let sensor_data = || QosPolicyBuilder::new().best_effort();
        let latched = || {
            let qos = QosPolicyBuilder::new().durability(Durability::TransientLocal);
            qos.reliable(RELIABLE_BLOCKING)
        };
        let [cloud, ..] = topics();
        let clouds = read(sensor_data(), name, cloud.schema, 1, CLOUDS_MAX)?;
        let mut poses = vec![];
        let topic = layout.odometry.as_deref().unwrap_or(ODOM);
        if layout.deskew {
            let schema = if topic.trim_start_matches('/') == TF[0].trim_start_matches('/') {
                TRANSFORMS
            } else {
                ODOMETRY
            };
            let moving = read(sensor_data(), topic, schema, POSES_MAX, POSES_MAX)?;
            let fixed = read(latched(), TF[1], TRANSFORMS, FIXED_MAX, FIXED_MAX)?;
            poses = vec![(fixed, TRANSFORMS, true), (moving, schema, false)];
        }
        Ok(Topics { clouds, poses, participant })
    }
}

impl Clouds {
    fn open(name: &str, layout: &Layout) -> anyhow::Result<Clouds> {
        if name.trim_matches('/').is_empty() {
            let text = format!("input: expected ros2:/TOPIC, found ros2:{name}");
            return Err(UsageError(text).into());
        }
        let topics = Topics::join(name, layout)?;
        let domain = topics.participant.domain_id();
        let buffer_bytes = std::fs::read_to_string(BUFFER).unwrap_or_default();
        if let Ok(bytes @ ..BUFFER_BYTES) = buffer_bytes.trim().parse::<u64>() {
            let expected = BUFFER_BYTES;
            tracing::warn!("{BUFFER}: {bytes}; below {expected} large clouds do not arrive whole");
        }
        tracing::info!(topic = name, domain, "listening");
        Ok(Clouds {
            name: name.to_string(),
            layout: layout.clone(),
            topics: Some(topics),
            odometry: Odometry::new(layout)?,
            heard: Instant::now(),
            wall_ns: wall_clock_ns(),
            patience: Patience::default(),
            last: None,
            missed: 0,
        })
    }

    /// Takes all waiting clouds and returns the newest. `None`: no cloud was waiting.
    fn newest(&mut self) -> Option<Vec<u8>> {
        let mut newest = None;
        let clouds = &mut self.topics.as_mut()?.clouds;
        clouds.drain_read_notifications();
        loop {
            match clouds.try_take_one() {
                Ok(None) => return newest,
                Ok(Some(message)) => {
                    let (writer, sequence) =
                        (message.writer_guid(), message.sequence_number.into());
                    let last = self.last.replace((writer, sequence));
                    let last = last.filter(|(guid, _)| *guid == writer);
                    let lost = last.map_or(0, |(_, last)| sequence - last - 1);
                    self.missed += u64::try_from(lost).unwrap_or(0) + u64::from(newest.is_some());
                    newest = Some(message.into_value());
                }
                Err(error) => {
                    self.missed += 1;
                    tracing::warn!("cannot read a message: {error}");
                }
            }
        }
    }
}

impl LiveScans for Clouds {
    fn load(&mut self, scan: &mut Scan, patience: Duration) -> anyhow::Result<Next> {
        let begun = Instant::now();
        loop {
            let waker = Waker::from(Arc::new(Unpark(current())));
            if let Some(topics) = &mut self.topics {
                topics.clouds.set_waker(Some(waker));
            }
            let newest = self.newest();
            let now_ns = wall_clock_ns();
            let is_set_back = std::mem::replace(&mut self.wall_ns, now_ns) > now_ns + 1_000_000_000;
            if self.patience.is_over(newest.is_some()) || is_set_back {
                // Drop the old topics first, to free their ports: others may know this process only by its ports.
                self.topics = None;
                self.topics = anew(Topics::join(&self.name, &self.layout));
            }
            if let Some(message) = newest {
                self.heard = Instant::now();
                let frame = scan.take_point_cloud2(&self.layout, &message, wall_clock_ns());
                let poses = self.topics.iter_mut().flat_map(|topics| &mut topics.poses);
                for (reader, schema, is_fixed) in poses {
                    reader.drain_read_notifications();
                    while let Ok(Some(message)) = reader.try_take_one() {
                        self.odometry.take(schema, *is_fixed, &message.into_value());
                    }
                }
                if self.layout.deskew {
                    self.odometry.correct(scan, &frame);
                }
                (scan.offset_ns, scan.missed) = (None, std::mem::take(&mut self.missed));
                scan.name.clear();
                return Ok(Next::Scan);
            }
            match patience.checked_sub(begun.elapsed()) {
                Some(left) => park_timeout(left),
                None => return Ok(Next::NotYet),
            }
        }
    }

    fn silence(&self) -> Option<String> {
        let words = || format!("no message on the ROS 2 topic {}", self.name);
        (self.heard.elapsed().as_secs() > 0).then(words)
    }
}

/// Wakes the thread that waits for a cloud.
struct Unpark(Thread);

impl Wake for Unpark {
    fn wake(self: Arc<Self>) {
        self.0.unpark();
    }
}
