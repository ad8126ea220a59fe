//! What is sent, and how often.

use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Result, ensure};
use mluc_ipc_types::{Topic, feature_blocks};
use serde::{Deserialize, Serialize};

/// Whose queue settings and elements a message has: a topic's, in the order of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
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

    /// Bytes of the largest message; of features a dense map of 200 x 176 cells with 256 channels, as `second` has it: 36 MB.
    pub const fn largest_bytes(self) -> usize {
        let topic = self.topic();
        let elements = match self {
            Payload::Features => feature_blocks(200 * 176, 256, 0),
            _ => topic.elements_max,
        };
        elements * topic.element_bytes
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
    /// Before each message: long enough that the receiver sleeps.
    pub pause: Duration,
    /// The receiver's program; `None`: this one.
    pub program: Option<PathBuf>,
}

impl Settings {
    /// The largest messages of a topic, the rest as usual.
    pub fn new(payload: Payload, rounds: usize) -> Settings {
        Settings {
            payload,
            bytes: payload.largest_bytes(),
            rounds,
            warm_up: 40,
            pause: Duration::from_millis(1),
            program: None,
        }
    }

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
