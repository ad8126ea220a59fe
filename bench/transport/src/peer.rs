//! The receiving process.

use std::io::{Read, Write};

use rustix::process::{Signal, set_parent_process_death_signal};

use crate::TransportError;
use crate::control::{Order, READY, WORD, answer};
use crate::pin::Pin;
use crate::way::{Receiver, Way};

/// Call it first in `main`. If this process was started to be the other side of a measurement, it is that until the
/// measurement ends, and `true` comes back: then return from `main`. Otherwise `false` comes back at once.
pub fn serve_peer() -> Result<bool, TransportError> {
    let words: Vec<_> = std::env::args_os().skip(1).collect();
    match words.split_first() {
        Some((first, rest)) if first == WORD => serve(&Order::parse(rest)?).map(|()| true),
        _ => Ok(false),
    }
}

fn serve(order: &Order) -> Result<(), TransportError> {
    // A sender that was killed closes no pipe in time when this process waits for a message.
    set_parent_process_death_signal(Some(Signal::TERM))
        .map_err(|source| TransportError::io("tying this process to its parent")(source.into()))?;
    let _pin = Pin::to(order.core)?;
    let mut receivers: Vec<(Way, Box<dyn Receiver>)> = vec![];
    for &way in &order.ways {
        receivers.push((way, order.link.receiver(way)?));
    }
    let (mut input, mut output) = (std::io::stdin().lock(), std::io::stdout().lock());
    let told = TransportError::io("answering the sending process");
    let mut tell = |bytes: &[u8]| output.write_all(bytes).and_then(|()| output.flush());
    if let Err(error) = tell(&[READY]) {
        return Err(told(error));
    }
    let mut named = [0];
    while input.read_exact(&mut named).is_ok() {
        let receiver = receivers.iter_mut().find(|(way, _)| *way as u8 == named[0]);
        let Some((_, receiver)) = receiver else {
            return Err(TransportError::Argument {
                expected: "a way that is open",
                found: named[0].to_string(),
            });
        };
        if tell(&answer(receiver.receive()?)).is_err() {
            break;
        }
    }
    Ok(())
}
