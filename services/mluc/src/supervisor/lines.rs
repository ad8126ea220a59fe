//! JSON lines to a writer that may be slow: a thread of its own, so that a full pipe never stops the supervisor.

use std::io::{self, Write};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;

use mluc_gateway::lines::line;
use mluc_ipc_types::{FrameHeader, Object};

use super::Sink;
use crate::settings::Pace;

/// Lines that wait for the reader.
const LINES_WAITING: usize = 64;

/// Writes a line a frame.
pub struct LineWriter {
    lines: Option<SyncSender<Vec<u8>>>,
    thread: Option<JoinHandle<io::Result<()>>>,
    waits_for_reader: bool,
    dropped: u64,
}

impl LineWriter {
    /// At pace `complete` no line is dropped: the pipeline waits for the reader. At pace `sensor` the reader loses lines.
    pub fn new(pace: Pace, output: impl Write + Send + 'static) -> LineWriter {
        let (lines, waiting) = sync_channel(LINES_WAITING);
        LineWriter {
            lines: Some(lines),
            thread: Some(std::thread::spawn(move || write_all(waiting, output))),
            waits_for_reader: pace == Pace::Complete,
            dropped: 0,
        }
    }

    /// Waits until everything is written; gives the lines that were dropped.
    pub fn finish(mut self) -> io::Result<u64> {
        self.lines = None;
        match self.thread.take().map(JoinHandle::join) {
            Some(Ok(Err(error))) if error.kind() != io::ErrorKind::BrokenPipe => Err(error),
            Some(Err(_)) => Err(io::Error::other("the thread that writes lines ended")),
            _ => Ok(self.dropped),
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

impl Sink for LineWriter {
    fn frame(
        &mut self,
        header: &FrameHeader,
        objects: &[Object],
        classes: &[String],
    ) -> anyhow::Result<bool> {
        let mut bytes = serde_json::to_vec(&line(header, objects, classes))?;
        bytes.push(b'\n');
        let Some(lines) = &self.lines else {
            return Ok(false);
        };
        loop {
            match lines.try_send(bytes) {
                Ok(()) => return Ok(true),
                Err(TrySendError::Disconnected(_)) => return Ok(false),
                Err(TrySendError::Full(back)) if self.waits_for_reader => {
                    bytes = back;
                    std::thread::sleep(Duration::from_millis(2));
                }
                Err(TrySendError::Full(_)) => {
                    self.dropped += 1;
                    return Ok(true);
                }
            }
        }
    }
}
