//! Messages in turn on both ways.

use std::sync::atomic::{AtomicU32, Ordering};

use anyhow::{Result, ensure};
use mluc_geometry::quantile;

use super::load::Settings;
use super::peer::Peer;
use super::way::{Link, Sender, Way};

/// How long a message takes on one way: from the sender's clock right before sending to the receiver's clock once the whole message is
/// there.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Latencies {
    /// us, ascending.
    ascending_us: Vec<f64>,
}

impl Latencies {
    /// By nearest rank, us; 0 without values.
    pub fn at(&self, q: f64) -> f64 {
        quantile(&self.ascending_us, q).unwrap_or(0.0)
    }

    /// Messages that count.
    pub fn count(&self) -> usize {
        self.ascending_us.len()
    }
}

/// Sends in turn on both ways; of each of [`Way::ALL`] what it took.
pub fn measure(settings: &Settings) -> Result<[Latencies; 2]> {
    let link = Link {
        payload: settings.payload,
        elements: settings.elements()?,
        label: label(),
    };
    let mut ends: Vec<(Way, Sender)> = vec![];
    for way in Way::ALL {
        ends.push((way, link.sender(way)?));
    }
    let mut found = [Latencies::default(), Latencies::default()];
    let mut peer = Peer::start(settings.program.as_deref(), &link)?;
    for round in 0..settings.warm_up + settings.rounds {
        for turn in [0, 1] {
            // The order turns over each round: each way as often follows itself as the other one.
            let place = (round + turn) % 2;
            let (way, sender) = &mut ends[place];
            peer.expect(*way)?;
            std::thread::sleep(settings.pause);
            let latency_us = exchange(*way, sender, &mut peer, round as u32)?;
            if round >= settings.warm_up {
                found[place].ascending_us.push(latency_us);
            }
        }
    }
    // It ends first, so that this process is the last one everywhere and removes all files.
    drop(peer);
    for latencies in &mut found {
        latencies.ascending_us.sort_unstable_by(f64::total_cmp);
    }
    Ok(found)
}

/// Of this measurement alone.
fn label() -> String {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    format!("t{}-{count}", std::process::id())
}

fn exchange(way: Way, sender: &mut Sender, peer: &mut Peer, word: u32) -> Result<f64> {
    let sent = sender(word)?;
    let arrived = peer.arrived()?;
    let (way, expected, found) = (way.name(), sent.sum, arrived.sum);
    ensure!(
        found == expected,
        "{way}: a sum of {expected} was sent, {found} arrived"
    );
    Ok(arrived.at_ns.saturating_sub(sent.at_ns) as f64 / 1e3)
}
