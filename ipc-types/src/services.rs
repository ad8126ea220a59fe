//! The one table of services: both sides of every topic take their queue settings from here.

use crate::{
    CELLS_MAX, DETECTIONS_MAX, FEATURE_CHANNELS_MAX, GROUND_NODES_MAX, OBJECT_POINTS_MAX,
    OBJECTS_MAX, POINTS_MAX, feature_blocks,
};
use std::time::Duration;

/// Settings of one topic. It has one publisher, and overflow drops the oldest message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Topic {
    /// Last part of the service's name.
    pub name: &'static str,
    /// Elements of the largest message.
    pub elements_max: usize,
    /// Bytes of an element.
    pub element_bytes: usize,
    /// Consumers at the same time.
    pub subscribers_max: usize,
    /// Messages waiting for one consumer.
    pub buffer: usize,
    /// Messages that one consumer may hold.
    pub borrowed: usize,
    /// Messages that the producer may fill at the same time.
    pub loans: usize,
    /// Messages that a late consumer still gets.
    pub history: usize,
}

impl Topic {
    /// Silence after which a consumer reports a missing producer.
    pub const SILENCE_MAX: Duration = Duration::from_secs(1);

    /// Scans: ingest to backbone and refiner, to head and supervisor, which learn from them what was sent, and to two consumers.
    /// The topic is so deep that the refiner finds the points of a frame whose detections took two periods.
    pub const POINTS: Topic = Topic {
        name: "points",
        elements_max: POINTS_MAX,
        element_bytes: size_of::<crate::Point>(),
        subscribers_max: 6,
        buffer: 2,
        borrowed: 5,
        loans: 2,
        history: 0,
    };
    /// Feature rows: backbone to head. The producer's model determines the size of its messages: `elements_max` is a bound, not the pool's size.
    pub const FEATURES: Topic = Topic {
        name: "features",
        elements_max: feature_blocks(CELLS_MAX, FEATURE_CHANNELS_MAX, GROUND_NODES_MAX),
        element_bytes: size_of::<crate::FeatureBlock>(),
        subscribers_max: 2,
        buffer: 1,
        borrowed: 1,
        loans: 1,
        ..Topic::POINTS
    };
    /// Kept boxes: head to refiner, gateway.
    pub const DETECTIONS: Topic = Topic {
        name: "detections",
        elements_max: DETECTIONS_MAX,
        element_bytes: size_of::<crate::Detection>(),
        subscribers_max: 4,
        history: 1,
        ..Topic::POINTS
    };
    /// The result: refiner to the robot, gateway, ingest in pace `complete`.
    pub const OBJECTS: Topic = Topic {
        name: "objects",
        elements_max: OBJECTS_MAX,
        element_bytes: size_of::<crate::Object>(),
        subscribers_max: 8,
        ..Topic::DETECTIONS
    };
    /// Indices into the points: refiner to any consumer.
    pub const OBJECT_POINTS: Topic = Topic {
        name: "object_points",
        elements_max: OBJECT_POINTS_MAX,
        element_bytes: 4,
        subscribers_max: 3,
        borrowed: 2,
        ..Topic::FEATURES
    };
    /// Heartbeats: each stage to the supervisor, as a service of its own (`health/backbone`).
    pub const HEALTH: Topic = Topic {
        name: "health",
        elements_max: 1,
        element_bytes: size_of::<crate::Health>(),
        ..Topic::OBJECTS
    };
    /// What holds for all frames of a run ([`crate::RunDescription`]): supervisor to everybody. Latched: history 1, and the writer hands it to late readers.
    pub const RUN: Topic = Topic {
        name: "run",
        elements_max: 1,
        element_bytes: size_of::<crate::RunDescription>(),
        subscribers_max: 16,
        history: 1,
        ..Topic::FEATURES
    };
    /// The current state of the pipeline ([`crate::Status`]): supervisor to everybody, latched too.
    pub const STATUS: Topic =
        Topic { name: "status", element_bytes: size_of::<crate::Status>(), ..Topic::RUN };

    /// Number of messages in the producer's memory: as many as all consumers can keep at the same time, and the loans.
    pub const fn slots(&self) -> usize {
        self.subscribers_max * (self.buffer + self.borrowed) + self.history + self.loans
    }
}

const _: () = assert!(feature_blocks(16, 16, 0) == 17);
