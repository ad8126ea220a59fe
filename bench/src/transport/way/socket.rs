//! A Unix stream socket: the kernel copies the payload in and out.

use std::io::{Read, Write};
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixListener, UnixStream};

use anyhow::{Context, Result};
use mluc_runtime::monotonic_ns;

use super::{Arrived, Link, PATIENCE, Receiver, Sender, Sent, read, sum_of};

pub(super) fn sender(link: &Link) -> Result<Sender> {
    let listener = UnixListener::bind_addr(&address(link)?).context("making a socket")?;
    let mut words = vec![0; link.bytes() / 4];
    let mut connected = None;
    Ok(Box::new(move |word| {
        let stream = match &mut connected {
            Some(stream) => stream,
            // The receiver connected before it said that it is ready: this does not wait.
            None => connected.insert(listener.accept().context("taking a connection")?.0),
        };
        words.fill(word);
        let at_ns = monotonic_ns();
        let written = stream.write_all(bytemuck::cast_slice(&words));
        written.context("writing to the socket")?;
        Ok(Sent {
            at_ns,
            occupied_ns: monotonic_ns() - at_ns,
            sum: sum_of::<u32>(word, words.len()),
        })
    }))
}

pub(super) fn receiver(link: &Link) -> Result<Receiver> {
    let mut stream = UnixStream::connect_addr(&address(link)?)
        .and_then(|stream| stream.set_read_timeout(Some(PATIENCE)).map(|()| stream))
        .context("connecting to a socket")?;
    let mut words = vec![0u32; link.bytes() / 4];
    Ok(Box::new(move || {
        let bytes = bytemuck::cast_slice_mut(&mut words);
        stream.read_exact(bytes).context("reading the socket")?;
        Ok(Arrived {
            at_ns: monotonic_ns(),
            sum: read(&words),
        })
    }))
}

/// A name without a file: nothing stays behind.
fn address(link: &Link) -> Result<SocketAddr> {
    SocketAddr::from_abstract_name(format!("mluc-{}", link.label)).context("naming a socket")
}
