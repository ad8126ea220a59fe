//! A Unix stream socket: the kernel copies the payload in and out.

use std::io::{Read, Write};
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixListener, UnixStream};

use anyhow::{Context, Result};
use mluc_runtime::monotonic_ns;

use super::{Arrived, Link, PATIENCE, Receiver, Sender, Sent, read, sum_of};

pub(super) fn sender(link: &Link) -> Result<Box<dyn Sender>> {
    let listener = UnixListener::bind_addr(&address(link)?).context("making a socket")?;
    Ok(Box::new(SocketSender {
        listener,
        stream: None,
        words: vec![0; link.load.whole_bytes() / 4],
    }))
}

pub(super) fn receiver(link: &Link) -> Result<Box<dyn Receiver>> {
    let stream = UnixStream::connect_addr(&address(link)?)
        .and_then(|stream| stream.set_read_timeout(Some(PATIENCE)).map(|()| stream))
        .context("connecting to a socket")?;
    Ok(Box::new(SocketReceiver {
        stream,
        words: vec![0; link.load.whole_bytes() / 4],
    }))
}

/// A name without a file: nothing stays behind.
fn address(link: &Link) -> Result<SocketAddr> {
    SocketAddr::from_abstract_name(format!("mluc-{}", link.label)).context("naming a socket")
}

struct SocketSender {
    listener: UnixListener,
    stream: Option<UnixStream>,
    words: Vec<u32>,
}

impl Sender for SocketSender {
    fn peer_is_ready(&mut self) -> Result<()> {
        // It connected before it said that it is ready: this does not wait.
        let accepted = self.listener.accept();
        let (stream, _) = accepted.context("taking a connection")?;
        self.stream = Some(stream);
        Ok(())
    }

    fn send(&mut self, word: u32) -> Result<Sent> {
        let stream = self
            .stream
            .as_mut()
            .context("nobody is connected to the socket")?;
        self.words.fill(word);
        let at_ns = monotonic_ns();
        stream
            .write_all(bytemuck::cast_slice(&self.words))
            .context("writing to the socket")?;
        Ok(Sent {
            at_ns,
            occupied_ns: monotonic_ns() - at_ns,
            sum: sum_of::<u32>(word, self.words.len()),
        })
    }
}

struct SocketReceiver {
    stream: UnixStream,
    words: Vec<u32>,
}

impl Receiver for SocketReceiver {
    fn receive(&mut self) -> Result<Arrived> {
        self.stream
            .read_exact(bytemuck::cast_slice_mut(&mut self.words))
            .context("reading the socket")?;
        Ok(Arrived {
            at_ns: monotonic_ns(),
            sum: read(&self.words),
        })
    }
}
