//! Scans from a recording: the messages of one topic of an MCAP file, in the order of the file.

use crate::files::{CLOUDS, Cloud, Layout};
use crate::motion::{Odometry, POSES, TF};
use crate::{Next, Scan, SourceError, folder::has_scans, numbered, refused, rounds::Rounds};
use anyhow::{Context, Result};
use mcap::sans_io::{LinearReaderOptions, SummaryReadEvent, SummaryReader, SummaryReaderOptions};
use mcap::{Channel, McapError, Summary, io::MessageReader};
use mluc_ipc_types::Flags;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};
use std::{collections::BTreeMap, collections::BTreeSet, fs::File};

/// Maximum size of a chunk or any other record: many times the largest scan.
const RECORD_BYTES_MAX: usize = 256 << 20;
/// Maximum number of messages that one call reads: the caller must send heartbeats between calls.
pub(crate) const LOOKS_MAX: u32 = 64;
const READ_BYTES: usize = 1 << 20;
/// What is searched for, its message types, and the option that names its topic.
const SCANS: [&str; 3] = ["scans", CLOUDS, "--topic"];

/// `input` itself if it is a recording, or the only recording in a folder without scans, as rosbag2 writes them.
pub(crate) fn within(input: &Path, ending: &str) -> Option<PathBuf> {
    if ending == "mcap" && !input.is_dir() {
        return Some(input.to_path_buf());
    }
    let entries = input.read_dir().ok()?.flatten();
    let entries = entries.filter(|e| !e.file_name().as_encoded_bytes().starts_with(b"."));
    let paths = entries.map(|entry| entry.path());
    let mut found = paths.filter(|path| path.extension().is_some_and(|word| word == "mcap"));
    let first = found.next();
    let is_alone = |_: &PathBuf| found.next().is_none() && !has_scans(input);
    first.filter(is_alone)
}

pub(crate) struct Recording {
    path: PathBuf,
    /// Its `topic` is always set.
    layout: Layout,
    messages: MessageReader<BufReader<File>>,
    /// Number of messages on the topic; `None`: unknown.
    pub(crate) count: Option<u64>,
    /// Number of the next message.
    sequence: u64,
    /// Scan times, from the times at which the messages were recorded.
    rounds: Rounds,
    /// The topic of the poses, and the odometry read from it.
    motion: Option<(String, Odometry)>,
    /// The frame of the last cloud; `None` after a warning.
    frame: Option<String>,
}

impl Recording {
    pub(crate) fn open(path: &Path, layout: &Layout) -> Result<Recording> {
        let about = || format!("input {}", path.display());
        let summary = summary(path)?;
        let topic = layout.topic.as_deref();
        let chosen = choose(&summary, topic, |c| cloud(c).is_some(), SCANS);
        let (topic, channels) = chosen.with_context(about)?;
        for found in summary.chunk_indexes.iter().map(|chunk| &chunk.compression) {
            if !["", "lz4", "zstd"].contains(&found.as_str()) {
                let place = "compression of a chunk";
                return refused(place, "none, lz4 or zstd", found).with_context(about);
            }
        }
        let motion = layout.deskew.then(|| motion(&summary, layout)).transpose();
        let motion = motion.with_context(about)?;
        let odometry = Odometry::new(layout).with_context(about)?;
        let counts = summary.stats.map(|stats| stats.channel_message_counts);
        let count = counts.filter(|counts| !counts.is_empty());
        let count = count.map(|counts| channels.iter().filter_map(|id| counts.get(id)).sum());
        if count == Some(0u64) {
            let place = format!("messages on {topic}");
            return refused(place, "one or more", "none").with_context(about);
        }
        tracing::info!(topic, scans = count, poses = motion, "recording");
        Ok(Recording {
            path: path.to_path_buf(),
            layout: Layout { topic: Some(topic), ..layout.clone() },
            messages: messages(path)?,
            count,
            sequence: 0,
            rounds: Rounds::default(),
            motion: motion.map(|topic| (topic, odometry)),
            frame: Some(String::new()),
        })
    }

    /// Reads up to the message with this number, unless it is already loaded. `repeat`: the first message follows the last one.
    pub(crate) fn load(&mut self, sequence: u64, repeat: bool, scan: &mut Scan) -> Result<Next> {
        if sequence < self.sequence {
            return Ok(Next::Scan);
        }
        for _ in 0..LOOKS_MAX {
            let path = self.path.display();
            let message = match self.messages.next().transpose() {
                Err(error) if self.sequence > 0 && !matches!(error, McapError::Io(_)) => {
                    let (read, scans) = (self.sequence, self.count);
                    tracing::warn!(%path, read, scans, "the recording is damaged, its rest is not read: {error}");
                    None
                }
                message => message.with_context(|| format!("input {path}"))?,
            };
            match message {
                Some(message) if self.layout.topic.as_ref() == Some(&message.channel.topic) => {
                    let Some(cloud) = cloud(&message.channel) else {
                        continue;
                    };
                    let offset_ns = self.rounds.offset_ns(message.log_time);
                    self.sequence += 1;
                    if self.sequence > sequence {
                        let (data, ns) = (&message.data, message.log_time);
                        scan.name = numbered(sequence);
                        let frame = scan.take_cloud(cloud, &self.layout, data, ns);
                        let last = self.frame.as_deref().unwrap_or_default();
                        if !last.is_empty() && !frame.is_empty() && *last != frame {
                            tracing::warn!(%path, last, frame, "the topic has clouds in several frames: they are read as those of one sensor");
                            self.frame = None;
                        }
                        self.frame.as_mut().into_iter().for_each(|last| last.clone_from(&frame));
                        if let Some((_, odometry)) = &mut self.motion {
                            odometry.correct(scan, &frame);
                        }
                        scan.offset_ns = Some(offset_ns);
                        return Ok(Next::Scan);
                    }
                }
                Some(message) => {
                    let (topic, schema) = (&message.channel.topic, schema(&message.channel));
                    if let Some((poses, odometry)) = &mut self.motion
                        && (*topic == *poses || topic == TF[1])
                        && is_motion(&message.channel)
                    {
                        odometry.take(schema, topic == TF[1], &message.data);
                    }
                }
                None if !repeat || !self.rounds.next_round() => return Ok(Next::End),
                None => {
                    // Whole rounds that an earlier process has sent are not read again.
                    self.sequence *= (sequence / self.sequence).max(1);
                    self.messages = messages(&self.path)?;
                }
            }
        }
        Ok(Next::NotYet)
    }
}

/// Messages of one topic that `mluc record` wrote for a recording's frames in addition to their points.
pub struct Recorded {
    path: PathBuf,
    topic: String,
    messages: MessageReader<BufReader<File>>,
    /// Number of clouds read so far; `sequence`: the sequence number of the last cloud's message.
    clouds: u64,
    sequence: u32,
}

impl Recorded {
    /// Opens a recording. `writer`: command that writes recordings with the topic, for the error. Errors: the recording lacks the topic.
    pub fn open(path: &Path, topic: &str, writer: &str) -> Result<Recorded> {
        let about = || format!("input {}", path.display());
        let summary = summary(path).with_context(about)?;
        let mut names = summary.channels.values().map(|channel| &channel.topic);
        if !names.any(|name| name == topic) {
            let found = "a recording without it";
            let expected = format!("the topic {topic}, which `{writer}` writes");
            return refused(path.display(), expected, found).with_context(about);
        }
        Ok(Recorded {
            path: path.to_path_buf(),
            messages: messages(path)?,
            topic: topic.to_string(),
            clouds: 0,
            sequence: 0,
        })
    }

    /// The CDR message for the frame of the `number`th cloud; numbers must ascend from call to call. `None`: the frame has no message.
    pub fn of(&mut self, number: u64) -> Result<Option<Vec<u8>>> {
        while self.clouds <= number + 1 {
            let message = self.messages.next().transpose();
            let message = message.with_context(|| format!("input {}", self.path.display()))?;
            let Some(message) = message else { break };
            if cloud(&message.channel).is_some() {
                (self.clouds, self.sequence) = (self.clouds + 1, message.sequence);
            } else if message.channel.topic == self.topic
                && (self.clouds, self.sequence) == (number + 1, message.sequence)
            {
                return Ok(Some(message.data.into_owned()));
            }
        }
        Ok(None)
    }
}

impl Scan {
    /// Takes a `sensor_msgs/PointCloud2` in CDR. An invalid message is logged and gives an empty scan with the flag `damaged_input`. `heard_ns`
    /// replaces a stamp of 0. The name stays empty. Returns the coordinate frame of the points.
    pub fn take_point_cloud2(&mut self, layout: &Layout, message: &[u8], heard_ns: u64) -> String {
        self.name.clear();
        self.take_cloud(Cloud::Ros2, layout, message, heard_ns)
    }

    fn take_cloud(&mut self, cloud: Cloud, layout: &Layout, message: &[u8], ns: u64) -> String {
        self.bytes.clear();
        self.times_ns.clear();
        let found = cloud.convert(layout, message, self);
        let (stamp_ns, is_damaged, frame) = found.unwrap_or_else(|error| {
            tracing::warn!(scan = %self.name, topic = layout.topic, "cannot read a message, an empty frame takes its place: {error}");
            self.bytes.clear();
            (0, true, String::new())
        });
        if is_damaged && !self.bytes.is_empty() {
            tracing::warn!(scan = %self.name, topic = layout.topic, "damaged: a message has fewer or more points than it says");
        }
        let damaged = is_damaged.then_some(Flags::DAMAGED_INPUT);
        self.flags = damaged.unwrap_or_default();
        let stamp_ns = Some(stamp_ns).filter(|stamp_ns| *stamp_ns > 0);
        self.stamp_ns = stamp_ns.or(Some(ns));
        self.pose = None;
        frame
    }
}

fn messages(path: &Path) -> Result<MessageReader<BufReader<File>>, SourceError> {
    let file = File::open(path).map_err(|cause| SourceError::io(path.display(), cause))?;
    let options = LinearReaderOptions::default().with_record_length_limit(RECORD_BYTES_MAX);
    let options = options.with_validate_chunk_crcs(true);
    let file = BufReader::with_capacity(READ_BYTES, file);
    Ok(MessageReader::new_with_options(file, options))
}

fn schema<'a>(channel: &'a Channel) -> &'a str {
    channel.schema.as_ref().map_or("", |schema| &schema.name)
}

fn cloud(channel: &Channel) -> Option<Cloud> {
    Cloud::of(schema(channel), &channel.message_encoding)
}

/// The requested or only topic with suitable channels, and these channels. The array: what is searched for, its message types, the topic's option.
fn choose(
    summary: &Summary,
    wanted: Option<&str>,
    is_taken: impl Fn(&Channel) -> bool,
    [what, kinds, option]: [&str; 3],
) -> Result<(String, Vec<u16>), SourceError> {
    let (mut found, mut others) = (BTreeMap::<_, Vec<u16>>::new(), BTreeSet::new());
    for (id, channel) in &summary.channels {
        let (topic, encoding) = (channel.topic.clone(), &channel.message_encoding);
        if wanted.is_none_or(|wanted| wanted == topic) && is_taken(channel) {
            found.entry(topic).or_default().push(*id);
        } else {
            others.insert(format!("{topic} ({}, {encoding})", schema(channel)));
        }
    }
    if found.len() > 1 {
        let topics = found.into_keys().collect::<Vec<_>>().join(", ");
        let expected = format!("one, or which of them with {option}");
        return refused(format!("topics of {what}"), expected, topics);
    }
    let expected = format!("{} of {kinds}", wanted.unwrap_or("a topic"));
    let others = || match others.len() {
        0 => "no channels in the summary (`mcap recover IN -o OUT` writes them)".to_owned(),
        _ => Vec::from_iter(others).join(", "),
    };
    found
        .pop_first()
        .ok_or_else(|| SourceError::field(format!("topic of {what}"), expected, others()))
}

fn is_motion(channel: &Channel) -> bool {
    POSES.contains(&schema(channel)) && channel.message_encoding == "cdr"
}

/// The requested topic of poses, or `/tf`, or the only other topic of poses.
fn motion(summary: &Summary, layout: &Layout) -> Result<String, SourceError> {
    let has = |topic: &str| summary.channels.values().any(|c| c.topic == topic && is_motion(c));
    let wanted = layout.odometry.as_deref().or(has(TF[0]).then_some(TF[0]));
    let is_taken = |channel: &Channel| channel.topic != TF[1] && is_motion(channel);
    let poses = POSES.join(", ");
    choose(summary, wanted, is_taken, ["poses", &poses, "--odometry"]).map(|(topic, _)| topic)
}

/// Reads the summary. Errors: the file is not an MCAP file, or has no summary.
fn summary(path: &Path) -> Result<Summary, SourceError> {
    let expected = "an MCAP file with a summary at its end";
    let fault = |found: String| SourceError::field(path.display(), expected, found);
    let help = "was it cut short? `mcap recover IN -o OUT` helps";
    let cut = |what: &str| fault(format!("{what}: {help}"));
    let io = |cause| SourceError::io(path.display(), cause);
    let mut file = File::open(path).map_err(io)?;
    let mut magic = [0; 8];
    if file.read_exact(&mut magic).is_err() || magic != mcap::MAGIC {
        return Err(fault("another file".to_string()));
    }
    let options = SummaryReaderOptions::default().with_record_length_limit(RECORD_BYTES_MAX);
    let size = file.metadata().map_err(io)?.len();
    let mut reader = SummaryReader::new_with_options(options.with_file_size(size));
    while let Some(event) = reader.next_event() {
        match event.map_err(|error| cut(&error.to_string()))? {
            SummaryReadEvent::SeekRequest(to) => {
                let place = std::io::Seek::seek(&mut file, to).map_err(io)?;
                reader.notify_seeked(place);
            }
            SummaryReadEvent::ReadRequest(bytes) => {
                let count = file.read(reader.insert(bytes)).map_err(io)?;
                reader.notify_read(count);
            }
        }
    }
    reader.finish().ok_or_else(|| cut("no summary"))
}
