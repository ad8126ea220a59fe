//! Writes JSON lines in a separate thread, so that a reader that is slow, stops or leaves never stops the supervisor.

use crate::settings::Pace;
use anyhow::Context;
use crossbeam_channel::{Receiver, Sender, TrySendError, bounded};
use serde::Serialize;
use std::io::{self, ErrorKind, Write, stdout};
use std::{thread::JoinHandle, time::Duration, time::Instant};

/// Largest number of lines that wait for the reader.
const LINES_WAITING: usize = 64;
/// At pace `complete` ingest waits while this many lines wait: the queue still has room for the frames in the pipeline.
const LINES_HOLD: usize = 32;
/// Time for the reader at the end if the program was asked to end; the next limit is the time for each line at pace `sensor`.
const END_PATIENCE: Duration = Duration::from_millis(300);
const IDLE_PATIENCE: Duration = Duration::from_secs(2);
const FULL: [ErrorKind; 2] = [ErrorKind::StorageFull, ErrorKind::QuotaExceeded];

pub(crate) struct LineWriter {
    lines: Sender<Vec<u8>>,
    thread: JoinHandle<io::Result<u64>>,
    pace: Pace,
    dropped: u64,
}

impl LineWriter {
    /// At pace `complete` the pipeline waits for the reader, and no line is dropped. At pace `sensor` the reader loses lines.
    pub(crate) fn new(pace: Pace) -> LineWriter {
        let (lines, waiting) = bounded(LINES_WAITING);
        LineWriter {
            lines,
            thread: std::thread::spawn(move || write_all(waiting, stdout(), pace)),
            pace,
            dropped: 0,
        }
    }

    /// Hands a line on, without waiting. False: nobody reads any more.
    pub(crate) fn write(&mut self, line: &impl Serialize) -> anyhow::Result<bool> {
        Ok(self.hand_on(serde_json::to_vec(line)?))
    }

    /// Like [`LineWriter::write`], for text.
    pub(crate) fn hand_on(&mut self, mut line: Vec<u8>) -> bool {
        line.push(b'\n');
        let sent = self.lines.try_send(line);
        if matches!(sent, Err(TrySendError::Full(_))) {
            self.dropped += 1;
            tracing::warn!("a line was dropped: the reader of stdout is too slow");
        }
        !matches!(sent, Err(TrySendError::Disconnected(_)))
    }

    /// Whether the next frames have to wait for the reader.
    pub(crate) fn is_behind(&self) -> bool {
        self.pace == Pace::Complete && self.lines.len() >= LINES_HOLD
    }

    /// Waits for the reader, but not for ever after a failed run. Returns the number of dropped lines. `is_stopping`: asked to end.
    pub(crate) fn finish(
        self,
        has_failed: bool,
        is_stopping: impl Fn() -> bool,
    ) -> anyhow::Result<u64> {
        let (mut lines, mut waiting, mut since) = (Some(self.lines), 0, Instant::now());
        while !self.thread.is_finished() {
            let left = lines.as_ref().map_or(0, Sender::len);
            if left == 0 {
                // Without a sender the thread ends.
                lines = None;
            }
            if left != waiting && !is_stopping() {
                since = Instant::now();
            }
            waiting = left;
            let patience = match (is_stopping(), self.pace) {
                (true, _) => END_PATIENCE,
                (false, Pace::Complete) if !has_failed => Duration::MAX,
                (false, _) => IDLE_PATIENCE,
            };
            if since.elapsed() > patience {
                // One more line is being written.
                return Ok(self.dropped + waiting as u64 + 1);
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        match self.thread.join() {
            Ok(Err(error)) if error.kind() == ErrorKind::BrokenPipe => {
                Err(error).context("standard output: its reader is gone; further results are lost")
            }
            Ok(written) => written
                .map(|lost| self.dropped + lost)
                .context("writing JSON lines to standard output"),
            Err(_) => anyhow::bail!("the thread that writes lines ended"),
        }
    }
}

/// Returns the number of lines that a full disk has cost at pace `sensor`: consumers of shared memory need the pipeline.
fn write_all(waiting: Receiver<Vec<u8>>, mut output: impl Write, pace: Pace) -> io::Result<u64> {
    let (mut lost, mut is_torn) = (0, false);
    for mut line in waiting {
        if is_torn {
            // The part of the last line that was written must not continue in this one.
            line.insert(0, b'\n');
        }
        // A reader that follows the run sees each frame at once.
        let written = output.write_all(&line).and_then(|()| output.flush());
        let kind = written.as_ref().err().map(io::Error::kind);
        is_torn = pace == Pace::Sensor && kind.is_some_and(|kind| FULL.contains(&kind));
        if !is_torn {
            written?;
            continue;
        }
        lost += 1;
        tracing::warn!("a line was lost: the disk is full");
    }
    Ok(lost)
}
