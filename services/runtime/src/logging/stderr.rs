//! Stderr with a bounded wait: output that its reader does not take in time is lost and counted.

use super::log_line;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::{io, io::Write, sync::atomic::AtomicU64, sync::atomic::Ordering, time::Duration};
use tracing::Level;

/// Bytes that a writable pipe takes at once (PIPE_BUF).
const AT_ONCE: usize = 4096;

/// Number of messages that were lost since the last one that was written.
static LOST: AtomicU64 = AtomicU64::new(0);

/// Stderr of which each write waits at most this long for the reader.
#[derive(Clone, Copy, Debug)]
pub struct PatientStderr(pub Duration);

impl PatientStderr {
    /// Whether the reader takes a write now or within this time.
    pub fn is_ready(self) -> bool {
        let stderr = io::stderr();
        let mut ends = [PollFd::new(&stderr, PollFlags::OUT)];
        let patience = Timespec::try_from(self.0).ok();
        poll(&mut ends, patience.as_ref()).is_ok_and(|ready| ready > 0)
    }
}

impl Write for PatientStderr {
    /// Returns success even if the bytes are lost.
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if !self.is_ready() {
            LOST.fetch_add(1, Ordering::Relaxed);
            return Ok(bytes.len());
        }
        let lost = LOST.swap(0, Ordering::Relaxed);
        if lost > 0 {
            let message = format!("{lost} messages were lost: nobody read stderr");
            let line = log_line("log", Level::WARN, &message, &[]);
            writeln!(io::stderr(), "{line}")?;
        }
        io::stderr().write(&bytes[..bytes.len().min(AT_ONCE)])
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
