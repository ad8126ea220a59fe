//! The last scans, held where they lie in shared memory: a refiner finds the points of the frame whose detections it got.

use std::collections::VecDeque;

use mluc_ipc_types::Point;

use crate::{Input, Message, RuntimeError};

/// Scans kept after a frame was refined: the backbone has taken the newest or the one before it at about that time.
const PINNED: usize = 2;
/// Scans kept in all: the pinned ones, and the newest two for a backbone that waited. So the points of a frame are found
/// again however long the backbone takes; one more is held while it is being sorted in
/// ([`mluc_ipc_types::Topic::POINTS`]`.borrowed`).
const KEPT: usize = 4;

/// Scans by their sequence.
pub struct Scans {
    input: Input<Point>,
    held: VecDeque<Message<Point>>,
}

impl Scans {
    /// Holds what arrives at `input`.
    pub fn new(input: Input<Point>) -> Scans {
        Scans {
            input,
            held: VecDeque::with_capacity(KEPT + 1),
        }
    }

    /// Takes the scans that arrived.
    pub fn take(&mut self) -> Result<(), RuntimeError> {
        loop {
            if self.held.len() > KEPT {
                self.held.remove(PINNED);
            }
            match self.input.oldest()? {
                Some(scan) => self.held.push_back(scan),
                None => return Ok(()),
            }
        }
    }

    /// A frame was refined: lets go what no later frame can ask for.
    pub fn let_go(&mut self) {
        while self.held.len() > PINNED {
            self.held.pop_front();
        }
    }

    /// The points of a frame, if they are still there; unchecked.
    pub fn of(&self, sequence: u64) -> Option<&Message<Point>> {
        self.held
            .iter()
            .rev()
            .find(|scan| scan.header().sequence == sequence)
    }

    /// The input that they come from.
    pub fn input(&self) -> &Input<Point> {
        &self.input
    }
}
