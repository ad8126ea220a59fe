//! The scans of a run, as those behind the backbone see them: how many ingest has sent, and the last ones, held where they
//! lie in shared memory, so that a refiner finds the points of the frame whose detections it got.

use std::collections::VecDeque;

use mluc_ipc_types::{Point, RunDescription, Topic};

use crate::{Input, Message, Shell, error::Result, input::Wake};

/// Scans kept after a frame was refined: the backbone has taken the newest or the one before it at about that time.
const PINNED: usize = 2;
/// Scans kept in all: the pinned ones, and the newest two for a backbone that waited. So the points of a frame are found
/// again however long the backbone takes; one more is held while it is being sorted in ([`Topic::POINTS`]`.borrowed`).
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
    /// Counts what ingest sends; `holds`: and keeps the last ones.
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

    /// Takes the scans of a run that arrived, and shows each of them.
    pub fn take(
        &mut self,
        run: &RunDescription,
        mut show: impl FnMut(&Message<Point>),
    ) -> Result<()> {
        if self.run_id != run.run_id {
            (self.run_id, self.count_sent, self.ahead) = (run.run_id, 0, None);
            self.held.clear();
        }
        // Bounded: an ingest that publishes without end stops nothing else.
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

    /// The newest scan, once, where its frame is still to come (`done`: one more than the last frame's sequence) and no other
    /// scan was given ahead of one that is still to come.
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

    /// No frame is on its way: where ingest is gone, the scans that it left keep its memory, which the next one may need.
    pub(crate) fn let_orphans_go(&mut self) {
        if !self.held.is_empty() && self.input.producers() == 0 {
            self.held.clear();
        }
    }

    /// What ends a wait for the next scan, where scans are held.
    pub(crate) fn wake(&self) -> Option<Wake> {
        self.input.wake()
    }

    /// One more than the largest sequence that ingest has sent in the run; 0: none.
    pub fn count_sent(&self) -> u64 {
        self.count_sent
    }

    /// A frame was refined: lets go what no later frame can ask for.
    pub fn let_go(&mut self) {
        while self.held.len() > PINNED {
            self.held.pop_front();
        }
    }

    /// The points of a frame, if they are still there; unchecked.
    pub fn of(&self, sequence: u64) -> Option<&Message<Point>> {
        let mut newest_first = self.held.iter().rev();
        newest_first.find(|scan| scan.header().sequence == sequence)
    }

    /// Scans that were found inside a mapped segment of the instance.
    pub(crate) fn mappings_verified(&self) -> u64 {
        self.input.mappings_verified()
    }
}
