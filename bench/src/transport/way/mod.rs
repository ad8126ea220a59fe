//! The ways a message can go.

mod hop;
mod raw;

use std::time::Duration;

use anyhow::Result;
use mluc_ipc_types::{Detection, FeatureBlock, Object, Point};
use mluc_runtime::{Instance, Payload as Element};
use serde::{Deserialize, Serialize};

use super::load::Payload;

/// One way from process to process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// The stages' own: `mluc-runtime` with the one table of services.
    Hop,
    /// iceoryx2 alone, with the same queue settings, header and elements.
    Raw,
}

impl Way {
    /// All.
    pub const ALL: [Way; 2] = [Way::Hop, Way::Raw];

    /// `hop`, `raw`.
    pub fn name(self) -> &'static str {
        ["hop", "raw"][self as usize]
    }
}

pub(crate) const PATIENCE: Duration = Duration::from_secs(10);

fn silence(way: Way) -> String {
    let seconds = PATIENCE.as_secs();
    format!("{}: no message within {seconds} s", way.name())
}

/// What the sender knows of a message that it sent.
pub(crate) struct Sent {
    /// The clock right before sending, CLOCK_MONOTONIC.
    pub(crate) at_ns: u64,
    /// Of the words sent, modulo 2^32.
    pub(crate) sum: u32,
}

/// What the receiver knows of a message that it took.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub(crate) struct Arrived {
    /// The clock once the whole message was there.
    pub(crate) at_ns: u64,
    pub(crate) sum: u32,
}

/// The sender's end: fills a message with a word and sends it.
pub(crate) type Sender = Box<dyn FnMut(u32) -> Result<Sent>>;

/// The receiver's end: waits for a message, then reads all of it.
pub(crate) type Receiver = Box<dyn FnMut() -> Result<Arrived>>;

/// Makes a generic end for the elements that the topic of a link carries.
macro_rules! for_elements {
    ($link:expr, $($end:ident)::+) => {
        match $link.payload {
            Payload::Points => $($end)::+::<Point>($link),
            Payload::Features => $($end)::+::<FeatureBlock>($link),
            Payload::Detections => $($end)::+::<Detection>($link),
            Payload::Objects => $($end)::+::<Object>($link),
        }
    };
}

/// What both ends must agree on.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub(crate) struct Link {
    pub(crate) payload: Payload,
    pub(crate) elements: usize,
    /// Part of the name of everything shared.
    pub(crate) label: String,
}

impl Link {
    /// A pipeline of its own for each way.
    fn instance(&self, way: Way) -> Result<Instance> {
        Ok(Instance::new(&format!("{}-{}", self.label, way.name()))?)
    }

    pub(crate) fn sender(&self, way: Way) -> Result<Sender> {
        match way {
            Way::Hop => for_elements!(self, hop::sender),
            Way::Raw => for_elements!(self, raw::sender),
        }
    }

    pub(crate) fn receiver(&self, way: Way) -> Result<Receiver> {
        match way {
            Way::Hop => for_elements!(self, hop::receiver),
            Way::Raw => for_elements!(self, raw::receiver),
        }
    }
}

/// An element that is the same word everywhere.
fn element_of<T: Element>(word: u32) -> T {
    let mut element = T::zeroed();
    bytemuck::cast_slice_mut(std::slice::from_mut(&mut element)).fill(word);
    element
}

/// The sum of a message of such elements.
fn sum_of<T: Element>(word: u32, elements: usize) -> u32 {
    word.wrapping_mul((elements * size_of::<T>() / 4) as u32)
}

/// The sum of all words.
fn read<T: Element>(elements: &[T]) -> u32 {
    let words: &[u32] = bytemuck::cast_slice(elements);
    words.iter().fold(0, |sum, word| sum.wrapping_add(*word))
}
