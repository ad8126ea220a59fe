//! JSON lines to a writer that may be slow: a thread of its own, so that a full pipe never stops the supervisor.

use std::io::{self, ErrorKind, Write};
use std::thread::JoinHandle;
use std::time::Duration;

use crossbeam_channel::{Receiver, SendTimeoutError, Sender, bounded};
use serde::Serialize;

use crate::settings::Pace;

/// Lines that wait for the reader.
const LINES_WAITING: usize = 64;

pub(crate) struct LineWriter {
    lines: Sender<Vec<u8>>,
    thread: JoinHandle<io::Result<()>>,
    /// How long the pipeline waits for the reader.
    patience: Duration,
    dropped: u64,
}

impl LineWriter {
    /// At pace `complete` no line is dropped: the pipeline waits for the reader. At pace `sensor` the reader loses lines.
    pub(crate) fn new(pace: Pace, output: impl Write + Send + 'static) -> LineWriter {
        let (lines, waiting) = bounded(LINES_WAITING);
        LineWriter {
            lines,
            thread: std::thread::spawn(move || write_all(waiting, output)),
            patience: match pace {
                Pace::Complete => Duration::MAX,
                Pace::Sensor => Duration::ZERO,
            },
            dropped: 0,
        }
    }

    /// Hands a line on. False: nobody reads any more.
    pub(crate) fn write(&mut self, line: &impl Serialize) -> anyhow::Result<bool> {
        let mut bytes = serde_json::to_vec(line)?;
        bytes.push(b'\n');
        let sent = self.lines.send_timeout(bytes, self.patience);
        self.dropped += u64::from(matches!(sent, Err(SendTimeoutError::Timeout(_))));
        Ok(!matches!(sent, Err(SendTimeoutError::Disconnected(_))))
    }

    /// Waits until everything is written; gives the lines that were dropped.
    pub(crate) fn finish(self) -> io::Result<u64> {
        drop(self.lines);
        match self.thread.join() {
            Ok(Err(error)) if error.kind() != ErrorKind::BrokenPipe => Err(error),
            Ok(_) => Ok(self.dropped),
            Err(_) => Err(io::Error::other("the thread that writes lines ended")),
        }
    }
}

fn write_all(waiting: Receiver<Vec<u8>>, mut output: impl Write) -> io::Result<()> {
    for line in waiting {
        output.write_all(&line)?;
        // A reader that follows the run sees each frame at once.
        output.flush()?;
    }
    Ok(())
}
