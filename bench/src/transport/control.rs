//! How the two processes talk while they measure: bytes on the receiver's standard input and output.
//!
//! The receiver says [`READY`] once it is connected everywhere. Then, for each message: the sender names the way (one
//! byte), the receiver waits there and answers with what it saw. Closing its input ends it.

use std::io::{Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};

use super::way::{Arrived, Link, Way};

/// First word of the command line of a receiving process; the second is its [`Order`] as JSON.
pub(crate) const WORD: &str = "--transport-peer";
/// The receiver is connected.
pub(crate) const READY: u8 = 0x52;

/// What the receiver is to do.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Order {
    pub(crate) ways: Vec<Way>,
    pub(crate) link: Link,
    pub(crate) core: Option<usize>,
}

impl Order {
    pub(crate) fn parse(text: &str) -> Result<Order> {
        let order: Order = serde_json::from_str(text)
            .with_context(|| format!("the receiving process: an order expected, found `{text}`"))?;
        order.link.load.check()?;
        Ok(order)
    }
}

/// The receiving process as the sender sees it. Dropped, it ends.
pub(crate) struct Peer {
    child: Child,
    to: Option<ChildStdin>,
    from: ChildStdout,
}

impl Peer {
    /// Starts it and waits until it is connected.
    pub(crate) fn start(program: Option<&Path>, order: &Order) -> Result<Peer> {
        let program = match program {
            Some(program) => program.to_path_buf(),
            None => std::env::current_exe().context("finding this program")?,
        };
        let mut child = Command::new(program)
            .args([WORD, &serde_json::to_string(order)?])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .context("starting the receiving process")?;
        let (to, from) = (child.stdin.take(), child.stdout.take());
        let mut peer = Peer {
            child,
            to,
            from: from.context("a pipe from the receiving process")?,
        };
        // Some programs know nothing of all this.
        let [word] = peer.hear::<1>("starting")?;
        ensure!(word == READY, gone("starting"));
        Ok(peer)
    }

    /// Has it wait for a message on a way.
    pub(crate) fn expect(&mut self, way: Way) -> Result<()> {
        let to = self
            .to
            .as_mut()
            .context("the receiving process was asked to end")?;
        let written = to.write_all(&[way as u8]);
        written.with_context(|| gone("naming the next way"))
    }

    /// What it saw.
    pub(crate) fn arrived(&mut self) -> Result<Arrived> {
        let bytes = self.hear::<12>("waiting for what arrived")?;
        let [at_ns @ .., s0, s1, s2, s3] = bytes;
        Ok(Arrived {
            at_ns: u64::from_le_bytes(at_ns),
            sum: u32::from_le_bytes([s0, s1, s2, s3]),
        })
    }

    fn hear<const BYTES: usize>(&mut self, action: &str) -> Result<[u8; BYTES]> {
        let mut bytes = [0; BYTES];
        let heard = self.from.read_exact(&mut bytes);
        heard.with_context(|| gone(action))?;
        Ok(bytes)
    }
}

fn gone(action: &str) -> String {
    format!(
        "the receiving process is gone while {action}: its own message is above; the program must call serve_peer first in main"
    )
}

impl Drop for Peer {
    fn drop(&mut self) {
        // Its input ends; it leaves by itself, at the latest when its patience is over.
        drop(self.to.take());
        let _ = self.child.wait();
    }
}

/// As bytes: clock, then sum.
pub(crate) fn answer(arrived: Arrived) -> [u8; 12] {
    let mut bytes = [0; 12];
    bytes[..8].copy_from_slice(&arrived.at_ns.to_le_bytes());
    bytes[8..].copy_from_slice(&arrived.sum.to_le_bytes());
    bytes
}
