//! `mluc publish`: what `mluc record` writes, as live topics. Nothing in the pipeline waits for it, and it waits for no subscriber.

use anyhow::Context;
use bytes::Bytes;
use mluc_gateway::ros2::topics;
use mluc_runtime::Instance;
use mluc_view::Follower;
use rustdds::{Duration, QosPolicyBuilder, no_key::DataWriter};

use crate::dds::{Encoded, join, keep, topic};

/// Messages that are kept where nobody acknowledges any.
const DEPTH: i32 = 5;
/// Clouds and other messages that subscribers may leave unacknowledged; then the next ones are dropped. 2 s and 100 s at 10 Hz: a subscriber that is
/// gone is forgotten within 20 s.
const BEHIND_MAX: [i32; 2] = [20, 1000];

pub(crate) fn publish(instance: Option<Instance>) -> anyhow::Result<()> {
    let mut follower = Follower::open(instance)?;
    let participant = join()?;
    let publisher = participant.create_publisher(&QosPolicyBuilder::new().build())?;
    let mut writers: Vec<DataWriter<Bytes, Encoded>> = vec![];
    for (place, own) in topics().into_iter().enumerate() {
        let qos = QosPolicyBuilder::new().reliable(Duration::ZERO);
        let qos = keep(qos, DEPTH, BEHIND_MAX[usize::from(place > 0)]);
        let topic = topic(&participant, own.name, own.schema, &qos)?;
        let writer = publisher.create_datawriter_no_key(&topic, Some(qos));
        writers.push(writer.with_context(|| format!("topic {}", own.name))?);
    }
    let domain = participant.domain_id();
    tracing::info!(domain, "publishing; Ctrl-C ends it");
    let mut dropped = 0;
    while let Some(moment) = follower.next(|| true)? {
        // The channels are in the order of the topics; the line has none.
        for (writer, message) in writers.iter().zip(moment.messages) {
            let Some(message) = message else { continue };
            if let Err(error) = writer.write(message.into(), None) {
                dropped += 1;
                tracing::warn!(dropped, "a message was not sent: {error}");
            }
        }
    }
    let missed = follower.shell.health.frames_dropped;
    tracing::info!(missed, dropped, "ended");
    Ok(())
}
