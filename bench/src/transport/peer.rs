//! The receiving process.

use std::io::{Read, Write};

use anyhow::{Context, Result};
use rustix::process::{Signal, set_parent_process_death_signal};

use super::control::{Order, READY, WORD, answer};
use super::pin::Pin;
use super::way::{Receiver, Way};

/// Call it first in `main`. If this process was started to be the other side of a measurement, it is that until the
/// measurement ends, and `true` comes back: then return from `main`. Otherwise `false` comes back at once.
pub fn serve_peer() -> Result<bool> {
    let words = std::env::args_os().skip(1).take(2);
    let words: Vec<String> = words.map(|word| word.to_string_lossy().into()).collect();
    match &words[..] {
        [first, order] if first == WORD => serve(&Order::parse(order)?).map(|()| true),
        _ => Ok(false),
    }
}

fn serve(order: &Order) -> Result<()> {
    // A sender that was killed closes no pipe in time when this process waits for a message.
    end_with_parent()?;
    let _pin = Pin::to(order.core)?;
    let mut receivers: Vec<(Way, Box<dyn Receiver>)> = vec![];
    for &way in &order.ways {
        receivers.push((way, order.link.receiver(way)?));
    }
    let (mut input, mut output) = (std::io::stdin().lock(), std::io::stdout().lock());
    let mut tell = |bytes: &[u8]| output.write_all(bytes).and_then(|()| output.flush());
    tell(&[READY]).context("answering the sending process")?;
    let mut named = [0];
    while input.read_exact(&mut named).is_ok() {
        let receiver = receivers.iter_mut().find(|(way, _)| *way as u8 == named[0]);
        let (_, receiver) = receiver.context("the receiving process: the way named is not open")?;
        if tell(&answer(receiver.receive()?)).is_err() {
            break;
        }
    }
    Ok(())
}

/// Has the kernel send SIGTERM when the parent dies, however it dies.
pub(crate) fn end_with_parent() -> Result<()> {
    set_parent_process_death_signal(Some(Signal::TERM)).context("tying this process to its parent")
}
