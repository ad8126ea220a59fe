//! What is sent, and how often.

use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Result, ensure};
use mluc_ipc_types::Topic;
use serde::{Deserialize, Serialize};

/// Whose queue settings and elements a message has: a topic's, in the order of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub enum Payload {
    /// Ingest to backbone and refiner.
    Points,
    /// Backbone to head.
    Features,
    /// Head to refiner.
    Detections,
    /// Refiner to the robot.
    Objects,
}

impl Payload {
    /// In the order of a frame.
    pub const ALL: [Payload; 4] = [
        Payload::Points,
        Payload::Features,
        Payload::Detections,
        Payload::Objects,
    ];

    /// The topic that carries it.
    pub const fn topic(self) -> &'static Topic {
        match self {
            Payload::Points => &Topic::POINTS,
            Payload::Features => &Topic::FEATURES,
            Payload::Detections => &Topic::DETECTIONS,
            Payload::Objects => &Topic::OBJECTS,
        }
    }
}

/// How a measurement is made.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Whose queue settings and elements.
    pub payload: Payload,
    /// Size of a message, bytes; rounded up to whole elements.
    pub bytes: usize,
    /// Messages each way that count.
    pub rounds: usize,
    /// Messages each way before those: more than the pool has places, so that all of its pages are touched.
    pub warm_up: usize,
    /// Before each message, so that the receiver sleeps as it does in a pipeline.
    pub pause: Duration,
    /// The receiver's program; `None`: this one.
    pub program: Option<PathBuf>,
}

impl Settings {
    /// Elements of a message.
    pub(crate) fn elements(&self) -> Result<usize> {
        let topic = self.payload.topic();
        let elements = self.bytes.div_ceil(topic.element_bytes);
        ensure!(
            (1..=topic.elements_max).contains(&elements),
            "payload: 1 to {} bytes expected, found {}",
            topic.elements_max * topic.element_bytes,
            self.bytes
        );
        Ok(elements)
    }
}
