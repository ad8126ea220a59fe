//! The scans of a run for the stages after the backbone: how many scans ingest has sent, and the last ones, kept in shared
//! memory, so that a refiner finds the points of the frame whose detections it received.

use crate::{Input, Message, Shell, error::Result, input::Wake};
use mluc_ipc_types::{Point, RunDescription, Topic};
use std::collections::VecDeque;

/// Scans kept after a frame was refined: at about that time the backbone has taken the newest scan or the one before it.
const PINNED: usize = 2;
/// Scans kept in all: the pinned ones, and the newest two for a backbone that waited. So the points of a frame are found,
/// however long the backbone takes, if the refiner waits meanwhile. One more scan is held while it is being inserted ([`Topic::POINTS`]`.borrowed`).
const KEPT: usize = 4;

/// Scans by their sequence.
pub struct Scans {
    input: Input<Point>,
    held: VecDeque<Message<Point>>,
    kept: usize,
    run_id: u64,
    count_sent: u64,
    /// The scan that was shown ahead of its frame.
    ahead: Option<u64>,
}

impl Scans {
    /// Counts the scans that ingest sends. With `holds` it also keeps the last ones.
    pub fn open(shell: &Shell, holds: bool) -> Result<Scans> {
        let kept = if holds { KEPT } else { 0 };
        Ok(Scans {
            input: shell.open_input(&Topic::POINTS, holds)?,
            ahead: None,
            held: VecDeque::with_capacity(kept + 1),
            kept,
            run_id: 0,
            count_sent: 0,
        })
    }

    /// Takes the scans of a run that arrived, and calls `show` for each of them.
    pub fn take(
        &mut self,
        run: &RunDescription,
        mut show: impl FnMut(&Message<Point>),
    ) -> Result<()> {
        if self.run_id != run.run_id {
            (self.run_id, self.count_sent, self.ahead) = (run.run_id, 0, None);
            self.held.clear();
        }
        // Bounded: an ingest that publishes without pause must not block the caller.
        for _ in 0..2 * Topic::POINTS.buffer {
            if self.held.len() > self.kept {
                self.held.remove(PINNED);
            }
            let Some(scan) = self.input.oldest()? else {
                return Ok(());
            };
            let Ok(header) = scan.header().checked_in(run, 0..u64::MAX) else {
                continue;
            };
            self.count_sent = self.count_sent.max(header.sequence + 1);
            show(&scan);
            if self.kept > 0 {
                self.held.push_back(scan);
            }
        }
        Ok(())
    }

    /// The newest scan, returned once, if its frame is still to come (`done`: one more than the last frame's sequence) and no
    /// other scan whose frame is still to come was returned before.
    pub(crate) fn ahead(&mut self, done: u64) -> Option<&Message<Point>> {
        let is_open = |sequence: u64| sequence >= done;
        let newest = self.held.back()?;
        let sequence = newest.header().sequence;
        if !is_open(sequence) || self.ahead.is_some_and(is_open) {
            return None;
        }
        self.ahead = Some(sequence);
        Some(newest)
    }

    /// Called while no frame is in the pipeline. Drops the scans of an ingest that is gone: they keep its memory, which the next one may need.
    pub(crate) fn let_orphans_go(&mut self) {
        if !self.held.is_empty() && self.input.producers() == 0 {
            self.held.clear();
        }
    }

    /// The listener that ends a wait for the next scan; `None` if no scans are kept.
    pub(crate) fn wake(&self) -> Option<Wake> {
        self.input.wake()
    }

    /// One more than the largest sequence that ingest has sent in the run; 0: none.
    pub fn count_sent(&self) -> u64 {
        self.count_sent
    }

    /// Called when a frame was refined: releases the scans that no later frame can need.
    pub fn let_go(&mut self) {
        while self.held.len() > PINNED {
            self.held.pop_front();
        }
    }

    /// The points of a frame, if they are still there; unchecked.
    pub fn of(&self, sequence: u64) -> Option<&Message<Point>> {
        self.held.iter().rev().find(|scan| scan.header().sequence == sequence)
    }

    /// Scans that were found inside a mapped segment of the instance.
    pub(crate) fn mappings_verified(&self) -> u64 {
        self.input.mappings_verified()
    }
}
