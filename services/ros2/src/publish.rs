//! `mluc publish`: the messages of `mluc record` as live topics. Nothing in the pipeline waits for it, and it waits for no subscriber.

use crate::dds::{Encoded, Patience, anew, join, keep, topic};
use anyhow::Context;
use bytes::Bytes;
use mluc_gateway::ros2::topics;
use mluc_runtime::{Instance, wall_clock_ns};
use mluc_view::Follower;
use rustdds::{DataWriterStatus, DomainParticipant, DomainParticipantStatusEvent as Event};
use rustdds::{Duration, LostReason, QosPolicyBuilder, StatusEvented, no_key::DataWriter};

/// Number of sent clouds and of other sent messages that are kept. Clouds: at least `BEHIND_MAX`, or a new one replaces the one being sent.
const DEPTH: [i32; 2] = [10, 5];
/// Number of clouds and of other messages that may wait for subscribers (1 s and 100 s at 10 Hz); more are dropped. A lost subscriber counts for 20 s.
const BEHIND_MAX: [i32; 2] = [10, 1000];
/// After a pause of this length, other participants consider this process gone (leases of 10 s, renewed every 8 s).
const STILL_NS: u64 = 8_000_000_000;

struct Writers {
    /// One writer per topic, with its number of subscribers.
    writers: Vec<(DataWriter<Bytes, Encoded>, i32)>,
    participant: DomainParticipant,
}

/// The start of the topics' names: `/mluc`, and `/mluc_NAME` for another instance, so that two pipelines have topics of their own.
fn prefix(instance: &str) -> String {
    match instance {
        Instance::DEFAULT => "/mluc".to_owned(),
        name => format!("/mluc_{}", name.replace('-', "_")),
    }
}

impl Writers {
    fn join(instance: &str) -> anyhow::Result<Writers> {
        let participant = join()?;
        let publisher = participant.create_publisher(&QosPolicyBuilder::new().build())?;
        let mut writers = vec![];
        for (place, own) in topics().into_iter().enumerate() {
            let [depth, behind] = [DEPTH, BEHIND_MAX].map(|of| of[usize::from(place > 0)]);
            let reliable = QosPolicyBuilder::new().reliable(Duration::ZERO);
            let qos = keep(reliable, depth, behind);
            let name = own.name.replacen("/mluc", &prefix(instance), 1);
            let topic = topic(&participant, &name, own.schema, &qos)?;
            let writer = publisher.create_datawriter_no_key(&topic, Some(qos));
            writers.push((writer.with_context(|| format!("topic {name}"))?, 0));
        }
        Ok(Writers { writers, participant })
    }

    /// Whether the lease of a participant expired (network lost or process dead): rustdds would not accept it again.
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
    let instance = follower.shell.instance().name().to_owned();
    let (first, mut patience) = (Writers::join(&instance)?, Patience::default());
    let domain = first.participant.domain_id();
    let (mut topics, mut asked_ns) = (Some(first), wall_clock_ns());
    tracing::info!(domain, "publishing; Ctrl-C ends it");
    let mut dropped = 0;
    while let Some(moment) = follower.next(|| true)? {
        let have_lost = topics.as_ref().is_some_and(Writers::have_lost);
        let are_heard = topics.as_mut().is_some_and(Writers::are_heard);
        // A suspended machine counts no monotonic time.
        let now_ns = wall_clock_ns();
        let was_still = now_ns.abs_diff(std::mem::replace(&mut asked_ns, now_ns)) > STILL_NS;
        if patience.is_over(are_heard) || have_lost || was_still {
            // Drop the old participant first, to free its ports: others may know this process only by its ports.
            drop(topics.take());
            topics = anew(Writers::join(&instance));
        }
        let writers = topics.iter().flat_map(|topics| &topics.writers);
        // The writers are in the order of the messages; the frame's line has no writer.
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
