//! `mluc publish`: what `mluc record` writes, as live topics. Nothing in the pipeline waits for it, and it waits for no subscriber.

use std::time::Instant;

use anyhow::Context;
use bytes::Bytes;
use mluc_gateway::ros2::topics;
use mluc_runtime::Instance;
use mluc_view::Follower;
use rustdds::no_key::DataWriter;
use rustdds::{DataWriterStatus, DomainParticipant, DomainParticipantStatusEvent as Event};
use rustdds::{Duration, LostReason, QosPolicyBuilder, StatusEvented};

use crate::dds::{Encoded, Patience, anew, join, keep, topic};

/// Clouds and other messages that are kept after they were sent. No fewer clouds than may wait: the oldest, which is on its way, would be replaced.
const DEPTH: [i32; 2] = [10, 5];
/// And those that may wait for subscribers; then the next ones are dropped. 1 s and 100 s at 10 Hz: a subscriber that is gone is forgotten within 20 s.
const BEHIND_MAX: [i32; 2] = [10, 1000];

/// A process that stood still for so long is gone to the others (leases of 10 s, renewed all 8 s).
const STILL: std::time::Duration = std::time::Duration::from_secs(8);

struct Writers {
    /// One a topic, and how many subscribers it has.
    writers: Vec<(DataWriter<Bytes, Encoded>, i32)>,
    participant: DomainParticipant,
}

impl Writers {
    fn join() -> anyhow::Result<Writers> {
        let participant = join()?;
        let publisher = participant.create_publisher(&QosPolicyBuilder::new().build())?;
        let mut writers = vec![];
        for (place, own) in topics().into_iter().enumerate() {
            let [depth, behind] = [DEPTH, BEHIND_MAX].map(|of| of[usize::from(place > 0)]);
            let reliable = QosPolicyBuilder::new().reliable(Duration::ZERO);
            let qos = keep(reliable, depth, behind);
            let topic = topic(&participant, own.name, own.schema, &qos)?;
            let writer = publisher.create_datawriter_no_key(&topic, Some(qos));
            writers.push((writer.with_context(|| format!("topic {}", own.name))?, 0));
        }
        Ok(Writers {
            writers,
            participant,
        })
    }

    /// Whether a participant has gone without a word, for lack of a network or of life: it would not be taken back.
    fn have_lost(&self) -> bool {
        let listener = self.participant.status_listener();
        let events = std::iter::from_fn(|| listener.try_recv_status());
        let lost = events.filter(|event| match event {
            Event::ParticipantLost { reason, .. } => matches!(reason, LostReason::Timeout { .. }),
            _ => false,
        });
        lost.count() > 0
    }

    /// Whether anybody subscribes.
    fn are_heard(&mut self) -> bool {
        for (writer, subscribers) in &mut self.writers {
            while let Some(status) = writer.try_recv_status() {
                if let DataWriterStatus::PublicationMatched { current, .. } = status {
                    *subscribers = current.count();
                }
            }
        }
        self.writers.iter().any(|(_, subscribers)| *subscribers > 0)
    }
}

pub(crate) fn publish(instance: Option<Instance>) -> anyhow::Result<()> {
    let mut follower = Follower::open(instance)?;
    let (first, mut patience) = (Writers::join()?, Patience::default());
    let domain = first.participant.domain_id();
    let (mut topics, mut asked) = (Some(first), Instant::now());
    tracing::info!(domain, "publishing; Ctrl-C ends it");
    let mut dropped = 0;
    while let Some(moment) = follower.next(|| true)? {
        let have_lost = topics.as_ref().is_some_and(Writers::have_lost);
        let are_heard = topics.as_mut().is_some_and(Writers::are_heard);
        let was_still = std::mem::replace(&mut asked, Instant::now()).elapsed() > STILL;
        if patience.is_over(are_heard) || have_lost || was_still {
            // First the old one: others may know its ports alone.
            drop(topics.take());
            topics = anew(Writers::join());
        }
        let writers = topics.iter().flat_map(|topics| &topics.writers);
        // The channels are in the order of the topics; the line has none.
        for ((writer, _), message) in writers.zip(moment.messages) {
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
