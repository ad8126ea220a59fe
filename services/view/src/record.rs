//! `mluc record`: MCAP with the profile `ros2`, which ROS 2 plays, Foxglove and Rerun open, and `mluc up --input` reads.

use anyhow::{Context, Result};
use mcap::{Compression, WriteOptions, records::MessageHeader};
use mluc_gateway::ros2::{encode_bytes, line_topic, stage_topic, topics};
use mluc_ipc_types::{Detection, FeatureBlock, Stage, Topic};
use mluc_runtime::{Input, Payload, RuntimeError, Shell};
use mluc_view::{Follower, TOPICS};
use serde_json::json;
use std::collections::{BTreeMap, VecDeque};
use std::{fs::File, io::BufWriter, path::Path, process::ExitCode};

/// Exit code: the recording finished, but a frame is missing.
const EXIT_WARNINGS: u8 = 3;

pub(crate) fn record(mut follower: Follower, out: &Path, has_stages: bool) -> Result<ExitCode> {
    let about = || format!("recording to {}", out.display());
    let mut stages = None;
    let mut all = Vec::from(topics());
    all.push(line_topic());
    if has_stages {
        let features = StageMessages::<FeatureBlock>::open(&follower.shell, &Topic::FEATURES)?;
        let detections = StageMessages::<Detection>::open(&follower.shell, &Topic::DETECTIONS)?;
        stages = Some((features, detections));
        all.extend([Stage::Backbone, Stage::Head].map(stage_topic));
    }
    // An existing file is not overwritten.
    let file = BufWriter::new(File::create_new(out).with_context(about)?);
    // lz4: the pipeline needs the processor.
    let options = WriteOptions::new().profile("ros2");
    let options = options.compression(Some(Compression::Lz4));
    let mut writer = options.create(file).with_context(about)?;
    let mut channels = vec![];
    let line = line_topic();
    for topic in &all {
        let schema = writer.add_schema(topic.schema, "ros2msg", topic.definition.as_bytes())?;
        channels.push(writer.add_channel(schema, topic.name, "cdr", &BTreeMap::new())?);
    }
    let (mut frames, mut without_points, mut without_stages) = (0, 0, 0);
    tracing::info!("{}; Ctrl-C ends it", about());
    while let Some(moment) = follower.next(|| true)? {
        let lacks_points = moment.sequence.is_some() && moment.messages[0].is_none();
        let mut of_stages = vec![];
        if let (Some((features, detections)), Some(sequence)) = (&mut stages, moment.sequence) {
            let frame = (follower.shell.run().map_or(0, |run| run.run_id), sequence);
            of_stages = vec![features.of(frame)?, detections.of(frame)?];
        }
        let lacks_stages = of_stages.contains(&None);
        // Skips incomplete frames at the start: their scans may be older than this process.
        if frames == 0 && (lacks_points || lacks_stages) {
            continue;
        }
        frames += u64::from(moment.sequence.is_some());
        without_points += u64::from(lacks_points);
        without_stages += u64::from(lacks_stages);
        // The channels are in the order of the messages. The last one becomes a text message, so that ROS can read the file.
        let mut messages = moment.messages;
        if let Some(json) = messages.last_mut().and_then(Option::take) {
            let text = String::from_utf8(json).context("a line")?;
            messages[TOPICS - 1] = Some(line.encode(&json!({"data": text})));
        }
        for (&channel_id, message) in channels.iter().zip(messages.iter().chain(&of_stages)) {
            let header = MessageHeader {
                channel_id,
                sequence: moment.sequence.unwrap_or(0) as u32,
                log_time: moment.log_ns,
                publish_time: moment.log_ns,
            };
            if let Some(data) = message {
                writer.write_to_known_channel(&header, data).with_context(about)?;
            }
        }
    }
    writer.finish().with_context(about)?;
    writer.into_inner().into_inner().with_context(about)?.sync_all().with_context(about)?;
    let missed = follower.shell.health.frames_dropped;
    let path = out.display();
    tracing::info!(frames, missed, without_points, without_stages, "recorded {path}");
    let is_whole = frames > 0 && missed + without_points + without_stages == 0;
    Ok(ExitCode::from(if is_whole { 0 } else { EXIT_WARNINGS }))
}

/// Keeps a stage's messages until the objects of the same frame arrive.
struct StageMessages<T: Payload> {
    input: Input<T>,
    /// Messages with their run and sequence.
    waiting: VecDeque<((u64, u64), Vec<u8>)>,
}

impl<T: Payload> StageMessages<T> {
    fn open(shell: &Shell, topic: &Topic) -> Result<StageMessages<T>, RuntimeError> {
        Ok(StageMessages { input: shell.side_input(topic)?, waiting: VecDeque::new() })
    }

    /// The message of a frame; `None`: a later message replaced it. Messages of earlier frames are dropped.
    fn of(&mut self, frame: (u64, u64)) -> Result<Option<Vec<u8>>, RuntimeError> {
        while let Some(message) = self.input.oldest()? {
            let (header, elements) = (message.header(), message.elements());
            let parts = [bytemuck::bytes_of(header), bytemuck::cast_slice(elements)];
            let key = (header.run_id, header.sequence);
            self.waiting.push_back((key, encode_bytes(parts)));
        }
        let (run_id, sequence) = frame;
        (self.waiting).retain(|((run, number), _)| *run == run_id && *number >= sequence);
        let found = self.waiting.iter().rposition(|(key, _)| *key == frame);
        let kept = found.and_then(|at| self.waiting.remove(at));
        Ok(kept.map(|(_, bytes)| bytes))
    }
}
