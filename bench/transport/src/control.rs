//! How the two processes talk while they measure: bytes on the receiver's standard input and output.
//!
//! The receiver says [`READY`] once it is connected everywhere. Then, for each message: the sender names the way (one
//! byte), the receiver waits there and answers with what it saw. Closing its input ends it.

use std::ffi::OsString;
use std::io::{Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use crate::load::Payload;
use crate::way::{Arrived, Link, Way};
use crate::{Load, TransportError, Wake};

/// First word of the command line of a receiving process.
pub(crate) const WORD: &str = "--transport-peer";
/// The receiver is connected.
pub(crate) const READY: u8 = 0x52;

/// What the receiver is told on its command line: ways, link, core.
#[derive(Clone, Debug)]
pub(crate) struct Order {
    pub(crate) ways: Vec<Way>,
    pub(crate) link: Link,
    pub(crate) core: Option<usize>,
}

impl Order {
    /// `hop,raw points 2097152 event LABEL 1`
    fn words(&self) -> [String; 6] {
        let ways: Vec<_> = self.ways.iter().map(|way| way.name()).collect();
        let wake = match self.link.wake {
            Wake::Event => "event",
            Wake::Poll => "poll",
        };
        [
            ways.join(","),
            self.link.load.payload.name().into(),
            self.link.load.bytes.to_string(),
            wake.into(),
            self.link.label.clone(),
            self.core.map_or("any".into(), |core| core.to_string()),
        ]
    }

    /// The words after [`WORD`].
    pub(crate) fn parse(words: &[OsString]) -> Result<Order, TransportError> {
        let at = |place: usize| {
            let word = words.get(place).map(|word| word.to_string_lossy());
            word.unwrap_or_default().into_owned()
        };
        let wrong = |expected, place| TransportError::Argument {
            expected,
            found: at(place),
        };
        let ways: Option<Vec<_>> = at(0).split(',').map(Way::from_name).collect();
        let payload = Payload::from_name(&at(1)).ok_or_else(|| wrong("a topic", 1))?;
        let bytes = at(2).parse().map_err(|_| wrong("bytes", 2))?;
        let wake = match at(3).as_str() {
            "event" => Wake::Event,
            "poll" => Wake::Poll,
            _ => return Err(wrong("event or poll", 3)),
        };
        let core = match at(5).as_str() {
            "any" => None,
            core => Some(core.parse().map_err(|_| wrong("a core or any", 5))?),
        };
        let load = Load { payload, bytes };
        load.check()?;
        Ok(Order {
            ways: ways.ok_or_else(|| wrong("ways", 0))?,
            link: Link {
                load,
                wake,
                label: at(4),
            },
            core,
        })
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
    pub(crate) fn start(program: Option<&Path>, order: &Order) -> Result<Peer, TransportError> {
        let program = match program {
            Some(program) => program.to_path_buf(),
            None => std::env::current_exe().map_err(TransportError::io("finding this program"))?,
        };
        let mut child = Command::new(program)
            .arg(WORD)
            .args(order.words())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(TransportError::io("starting the receiving process"))?;
        let (to, from) = (child.stdin.take(), child.stdout.take());
        let gone = || TransportError::PeerGone { action: "starting" };
        let mut peer = Peer {
            child,
            to,
            from: from.ok_or_else(gone)?,
        };
        match peer.hear::<1>("waiting until it is connected")? {
            [READY] => Ok(peer),
            // Some program that knows nothing of all this.
            _ => Err(gone()),
        }
    }

    /// Has it wait for a message on a way.
    pub(crate) fn expect(&mut self, way: Way) -> Result<(), TransportError> {
        let gone = || TransportError::PeerGone {
            action: "naming the next way",
        };
        let to = self.to.as_mut().ok_or_else(gone)?;
        to.write_all(&[way as u8]).map_err(|_| gone())
    }

    /// What it saw.
    pub(crate) fn arrived(&mut self) -> Result<Arrived, TransportError> {
        let bytes = self.hear::<12>("waiting for what arrived")?;
        let [at_ns @ .., s0, s1, s2, s3] = bytes;
        Ok(Arrived {
            at_ns: u64::from_le_bytes(at_ns),
            sum: u32::from_le_bytes([s0, s1, s2, s3]),
        })
    }

    fn hear<const BYTES: usize>(
        &mut self,
        action: &'static str,
    ) -> Result<[u8; BYTES], TransportError> {
        let mut bytes = [0; BYTES];
        self.from
            .read_exact(&mut bytes)
            .map_err(|_| TransportError::PeerGone { action })?;
        Ok(bytes)
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    fn order() -> Order {
        Order {
            ways: vec![Way::Raw, Way::Socket],
            link: Link {
                load: Load::POINTS,
                wake: Wake::Poll,
                label: "t1".into(),
            },
            core: Some(1),
        }
    }

    #[test]
    fn what_is_ordered_is_understood() {
        let words: Vec<OsString> = order().words().into_iter().map(OsString::from).collect();
        let heard = Order::parse(&words).unwrap();
        assert_eq!(heard.ways, [Way::Raw, Way::Socket]);
        assert_eq!(
            (heard.link.load, heard.link.wake, heard.core),
            (Load::POINTS, Wake::Poll, Some(1))
        );
        assert_eq!(heard.link.label, "t1");
    }

    #[test]
    fn a_wrong_word_is_named() {
        let all: Vec<OsString> = order().words().into_iter().map(OsString::from).collect();
        for (place, word, part) in [
            (0, "raw,pigeon", "ways"),
            (1, "nonsense", "a topic"),
            (2, "-1", "bytes"),
            (2, "0", "1 to 2097152 bytes"),
            (3, "sleepy", "event or poll"),
            (5, "x", "a core"),
        ] {
            let mut words = all.clone();
            words[place] = word.into();
            let error = Order::parse(&words).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
        assert!(Order::parse(&[]).is_err());
    }
}
