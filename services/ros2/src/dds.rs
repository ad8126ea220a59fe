//! DDS as ROS 2 uses it: names of topics and types, the domain, messages that are in CDR already.

use anyhow::Context;
use bytes::Bytes;
use mluc::UsageError;
use rustdds::no_key::{Decode, DefaultDecoder, DeserializerAdapter, SerializerAdapter};
use rustdds::policy::{History, ResourceLimits};
use rustdds::{
    DomainParticipant, QosPolicies, QosPolicyBuilder, RepresentationIdentifier as Encoding, Topic,
    TopicKind,
};
use std::{convert::Infallible, time::Duration, time::Instant};

/// The largest domain that leaves room for the ports of 120 participants per machine (DDSI-RTPS 2.5, section 9.6.2).
const DOMAIN_MAX: u16 = 232;
/// CDR begins with the encoding and two bytes of options.
const HEAD_BYTES: usize = 4;

/// Joins the domain that `ROS_DOMAIN_ID` names, else 0.
pub(crate) fn join() -> anyhow::Result<DomainParticipant> {
    let word = std::env::var("ROS_DOMAIN_ID").unwrap_or_default();
    let domain = if word.is_empty() { Ok(0) } else { word.parse() };
    let domain = domain.ok().filter(|domain| *domain <= DOMAIN_MAX);
    let refused = || format!("ROS_DOMAIN_ID: expected 0 to {DOMAIN_MAX}, found '{word}'");
    let domain = domain.ok_or_else(|| UsageError(refused()))?;
    DomainParticipant::new(domain).with_context(|| format!("joining the DDS domain {domain}"))
}

/// Decides when to join the domain again. rustdds 0.14 loses a participant's announcements if another participant joins at the same moment,
/// and it does not accept a participant again after its lease expired.
pub(crate) struct Patience {
    heard: Instant,
    joined: Instant,
    limit: Duration,
}

/// Shortest and longest silence before the domain is joined again.
const PATIENCE: [Duration; 2] = [Duration::from_secs(5), Duration::from_secs(60)];

impl Default for Patience {
    fn default() -> Patience {
        Patience { heard: Instant::now(), joined: Instant::now(), limit: PATIENCE[0] }
    }
}

impl Patience {
    /// Whether the silence exceeds the limit: twice the last interval between two messages, within `PATIENCE`. Each time it does, the limit doubles.
    pub(crate) fn is_over(&mut self, is_heard: bool) -> bool {
        let [shortest, longest] = PATIENCE;
        if is_heard {
            self.limit = (2 * self.heard.elapsed()).clamp(shortest, longest);
            self.heard = Instant::now();
        }
        let is_over = self.heard.max(self.joined).elapsed() > self.limit;
        if is_over {
            self.limit = (2 * self.limit).min(longest);
            self.joined = Instant::now();
        }
        is_over
    }
}

/// The result of joining again; `None`: the error is logged, and joining is tried again later.
pub(crate) fn anew<T>(joined: anyhow::Result<T>) -> Option<T> {
    let warn = |error: &anyhow::Error| tracing::warn!("cannot join anew: {error:#}");
    joined.inspect_err(warn).ok()
}

/// A topic by its names in ROS, `/points` and `sensor_msgs/msg/PointCloud2` for instance.
pub(crate) fn topic(
    participant: &DomainParticipant,
    name: &str,
    schema: &str,
    qos: &QosPolicies,
) -> anyhow::Result<Topic> {
    let name = format!("rt/{}", name.trim_start_matches('/'));
    let kind = format!("{}_", schema.replace("/msg/", "::msg::dds_::"));
    Ok(participant.create_topic(name, kind, qos, TopicKind::NoKey)?)
}

/// QoS that keeps the last `depth` messages, and up to `count_max` while some are not acknowledged.
pub(crate) fn keep(qos: QosPolicyBuilder, depth: i32, count_max: i32) -> QosPolicies {
    let qos = qos.history(History::KeepLast { depth });
    let limits = ResourceLimits {
        max_samples: count_max,
        max_instances: 1,
        max_samples_per_instance: count_max,
    };
    qos.resource_limits(limits).build()
}

/// Codec for messages that are already in CDR, with their CDR header.
#[derive(Clone)]
pub(crate) struct Encoded;

impl SerializerAdapter<Bytes> for Encoded {
    type Error = Infallible;

    /// The encoding that [`mluc_gateway::ros2`] writes.
    fn output_encoding() -> Encoding {
        Encoding::CDR_LE
    }

    fn to_bytes(message: &Bytes) -> Result<Bytes, Infallible> {
        Ok(message.slice(HEAD_BYTES.min(message.len())..))
    }
}

impl DeserializerAdapter<Vec<u8>> for Encoded {
    type Error = Infallible;
    type Decoded = Vec<u8>;

    fn supported_encodings() -> &'static [Encoding] {
        &[Encoding::CDR_LE, Encoding::CDR_BE]
    }

    fn transform_decoded(message: Vec<u8>) -> Vec<u8> {
        message
    }
}

impl DefaultDecoder<Vec<u8>> for Encoded {
    type Decoder = Encoded;
    const DECODER: Encoded = Encoded;
}

impl Decode<'_, Vec<u8>> for Encoded {
    type Error = Infallible;

    fn decode_bytes(self, rest: &[u8], encoding: Encoding) -> Result<Vec<u8>, Infallible> {
        let head = [0, u8::from(encoding == Encoding::CDR_LE), 0, 0];
        Ok([&head, rest].concat())
    }
}
