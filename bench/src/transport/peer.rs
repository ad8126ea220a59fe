//! The receiving process, and how the two talk while they measure: lines on its standard input and output.
//!
//! The receiver says that it is connected everywhere. Then, for each message: the sender names the way, the receiver waits
//! there and answers with what it saw. Closing its input ends it.

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use anyhow::{Context, Result};
use rustix::process::{Signal, set_parent_process_death_signal};
use serde::de::DeserializeOwned;

use super::way::{Arrived, Link, Receiver, Way};

/// First word of the command line of a receiving process; the second is its [`Link`] as JSON.
const WORD: &str = "--transport-peer";

/// The receiving process as the sender sees it. Dropped, it ends.
pub(crate) struct Peer {
    child: Child,
    to: Option<ChildStdin>,
    from: BufReader<ChildStdout>,
}

impl Peer {
    pub(crate) fn start(program: Option<&Path>, link: &Link) -> Result<Peer> {
        let program = match program {
            Some(program) => program.to_path_buf(),
            None => std::env::current_exe().context("finding this program")?,
        };
        let mut child = Command::new(program)
            .args([WORD, &serde_json::to_string(link)?])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .context("starting the receiving process")?;
        let (to, from) = (child.stdin.take(), child.stdout.take());
        let from = from.context("a pipe from the receiving process")?;
        let mut peer = Peer {
            child,
            to,
            from: BufReader::new(from),
        };
        // Some programs know nothing of all this.
        peer.hear::<()>("starting")?;
        Ok(peer)
    }

    /// Has it wait for a message on a way.
    pub(crate) fn expect(&mut self, way: Way) -> Result<()> {
        let to = self.to.as_mut();
        let to = to.context("the receiving process was asked to end")?;
        writeln!(to, "{}", way.name()).with_context(|| gone("naming the next way"))
    }

    pub(crate) fn arrived(&mut self) -> Result<Arrived> {
        self.hear("waiting for what arrived")
    }

    fn hear<T: DeserializeOwned>(&mut self, action: &str) -> Result<T> {
        let mut line = String::new();
        self.from
            .read_line(&mut line)
            .with_context(|| gone(action))?;
        serde_json::from_str(&line).with_context(|| gone(action))
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

/// Call it first in `main`. If this process was started to be the other side of a measurement, it is that until the
/// measurement ends, and `true` comes back: then return from `main`. Otherwise `false` comes back at once.
pub(crate) fn serve_peer() -> Result<bool> {
    let words = std::env::args_os().skip(1).take(2);
    let words: Vec<String> = words.map(|word| word.to_string_lossy().into()).collect();
    let [WORD, link] = words.iter().map(String::as_str).collect::<Vec<_>>()[..] else {
        return Ok(false);
    };
    let wrong = || format!("the receiving process: an order expected, found `{link}`");
    serve(&serde_json::from_str(link).with_context(wrong)?)?;
    Ok(true)
}

fn serve(link: &Link) -> Result<()> {
    // A sender that was killed closes no pipe in time when this process waits for a message.
    set_parent_process_death_signal(Some(Signal::TERM))
        .context("tying this process to its parent")?;
    let mut receivers: Vec<(&str, Receiver)> = vec![];
    for way in Way::ALL {
        receivers.push((way.name(), link.receiver(way)?));
    }
    let mut output = std::io::stdout().lock();
    writeln!(output, "null").context("answering the sending process")?;
    for named in std::io::stdin().lines().map_while(Result::ok) {
        let receiver = receivers.iter_mut().find(|(way, _)| *way == named);
        let (_, receiver) = receiver.context("the receiving process: the way named is not open")?;
        let arrived = serde_json::to_string(&receiver()?)?;
        if writeln!(output, "{arrived}").is_err() {
            break;
        }
    }
    Ok(())
}
