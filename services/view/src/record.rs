//! `mluc record`: MCAP with the profile `ros2`, which ROS 2 plays, Foxglove and Rerun open, and `mluc up --input` reads.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use std::process::ExitCode;

use anyhow::Context;
use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions};
use mluc_gateway::ros2::{line_topic, topics};
use mluc_view::{Follower, TOPICS};
use serde_json::json;

/// Finished, but a frame is missing.
const EXIT_WARNINGS: u8 = 3;

pub(crate) fn record(mut follower: Follower, out: &Path) -> anyhow::Result<ExitCode> {
    let about = || format!("recording to {}", out.display());
    // Nothing that is there is overwritten.
    let file = BufWriter::new(File::create_new(out).with_context(about)?);
    // lz4: the pipeline needs the processor.
    let options = WriteOptions::new()
        .profile("ros2")
        .compression(Some(Compression::Lz4));
    let mut writer = options.create(file).with_context(about)?;
    let mut channels = vec![];
    let line = line_topic();
    for topic in topics().iter().chain([&line]) {
        let schema = writer.add_schema(topic.schema, "ros2msg", topic.definition.as_bytes())?;
        channels.push(writer.add_channel(schema, topic.name, "cdr", &BTreeMap::new())?);
    }
    let (mut frames, mut without_points) = (0, 0);
    tracing::info!("{}; Ctrl-C ends it", about());
    while let Some(moment) = follower.next(|| true)? {
        let lacks_points = moment.sequence.is_some() && moment.messages[0].is_none();
        // The scan of the first frame may be older than this process.
        if frames == 0 && lacks_points {
            continue;
        }
        frames += u64::from(moment.sequence.is_some());
        without_points += u64::from(lacks_points);
        // The channels are in the order of the messages; the last one is text, so that the file stays one of ROS.
        let mut messages = moment.messages;
        if let Some(json) = messages.last_mut().and_then(Option::take) {
            let text = String::from_utf8(json).context("a line")?;
            messages[TOPICS - 1] = Some(line.encode(&json!({"data": text})));
        }
        for (&channel_id, message) in channels.iter().zip(&messages) {
            let header = MessageHeader {
                channel_id,
                sequence: moment.sequence.unwrap_or(0) as u32,
                log_time: moment.log_ns,
                publish_time: moment.log_ns,
            };
            if let Some(data) = message {
                let written = writer.write_to_known_channel(&header, data);
                written.with_context(about)?;
            }
        }
    }
    writer.finish().with_context(about)?;
    let file = writer.into_inner().into_inner().with_context(about)?;
    file.sync_all().with_context(about)?;
    let missed = follower.shell.health.frames_dropped;
    tracing::info!(frames, missed, without_points, "recorded {}", out.display());
    let is_whole = missed + without_points == 0;
    Ok(ExitCode::from(if is_whole { 0 } else { EXIT_WARNINGS }))
}
