//! Messages in turn on every way.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU32, Ordering};

use anyhow::{Result, ensure};
use mluc_geometry::{Random, quantile};
use serde::Serialize;

use super::load::Settings;
use super::peer::Peer;
use super::way::{Link, Sender, Way};

/// Of one quantity, us.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct LatencyPercentiles {
    /// Values.
    pub count: usize,
    /// Half are at most this.
    pub p50_us: f64,
    /// 90 in 100.
    pub p90_us: f64,
    /// 99 in 100.
    pub p99_us: f64,
    /// 999 in 1000.
    pub p999_us: f64,
    /// The largest.
    pub max_us: f64,
}

impl LatencyPercentiles {
    /// By nearest rank; zeros without values.
    pub fn of_ns(values_ns: &[u64]) -> LatencyPercentiles {
        let mut ascending: Vec<f64> = values_ns.iter().map(|&ns| ns as f64 / 1e3).collect();
        ascending.sort_unstable_by(f64::total_cmp);
        let at = |q: f64| quantile(&ascending, q).unwrap_or(0.0);
        LatencyPercentiles {
            count: ascending.len(),
            p50_us: at(0.5),
            p90_us: at(0.9),
            p99_us: at(0.99),
            p999_us: at(0.999),
            max_us: at(1.0),
        }
    }
}

/// What one way costs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Cost {
    /// From the sender's clock right before sending to the receiver's clock once the whole message is there.
    pub latency: LatencyPercentiles,
    /// How long sending keeps the sender: lending memory, sending, waking; filling apart.
    pub sender: LatencyPercentiles,
}

/// Everything measured in one run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Measured {
    /// Bytes of a message.
    pub payload_bytes: usize,
    /// Each of [`Way::ALL`].
    pub ways: BTreeMap<Way, Cost>,
}

impl Measured {
    /// Of the hop and of iceoryx2 alone.
    pub fn latencies(&self) -> [LatencyPercentiles; 2] {
        Way::ALL.map(|way| self.ways[&way].latency)
    }
}

/// Sends in turn on every way, each time in another order.
pub fn measure(settings: &Settings) -> Result<Measured> {
    let elements = settings.elements()?;
    let link = Link {
        payload: settings.payload,
        elements,
        label: label(),
    };
    let mut ends = vec![];
    for way in Way::ALL {
        ends.push(End {
            way,
            sender: link.sender(way)?,
            latency_ns: Vec::with_capacity(settings.rounds),
            occupied_ns: Vec::with_capacity(settings.rounds),
        });
    }
    let mut peer = Peer::start(settings.program.as_deref(), &link)?;
    let payload_bytes = link.bytes();
    for round in 0..settings.warm_up + settings.rounds {
        let counts = round >= settings.warm_up;
        for place in shuffled(ends.len(), round as u64) {
            peer.expect(ends[place].way)?;
            std::thread::sleep(settings.pause);
            ends[place].exchange(&mut peer, round as u32, counts)?;
        }
    }
    // It ends first, so that this process is the last one everywhere and removes all files.
    drop(peer);
    let cost = |end: &End| Cost {
        latency: LatencyPercentiles::of_ns(&end.latency_ns),
        sender: LatencyPercentiles::of_ns(&end.occupied_ns),
    };
    Ok(Measured {
        payload_bytes,
        ways: ends.iter().map(|end| (end.way, cost(end))).collect(),
    })
}

/// Another order each round: no way shall always find the caches as the same other one left them.
fn shuffled(count: usize, round: u64) -> Vec<usize> {
    let mut places: Vec<usize> = (0..count).collect();
    Random::new(round, &[]).shuffle(&mut places);
    places
}

/// Of this measurement alone.
fn label() -> String {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    format!("t{}-{count}", std::process::id())
}

struct End {
    way: Way,
    sender: Sender,
    latency_ns: Vec<u64>,
    occupied_ns: Vec<u64>,
}

impl End {
    fn exchange(&mut self, peer: &mut Peer, word: u32, counts: bool) -> Result<()> {
        let sent = (self.sender)(word)?;
        let arrived = peer.arrived()?;
        let (way, expected, found) = (self.way.name(), sent.sum, arrived.sum);
        ensure!(
            found == expected,
            "{way}: a sum of {expected} was sent, {found} arrived"
        );
        if counts {
            let latency_ns = arrived.at_ns.saturating_sub(sent.at_ns);
            self.latency_ns.push(latency_ns);
            self.occupied_ns.push(sent.occupied_ns);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_way_follows_every_other_about_as_often() {
        let mut follows = [[0; 4]; 4];
        for round in 0..4000 {
            let order = shuffled(4, round);
            for pair in order.windows(2) {
                follows[pair[0]][pair[1]] += 1;
            }
        }
        for (a, row) in follows.iter().enumerate() {
            for (b, count) in row.iter().enumerate() {
                let expected = if a == b { 0..1 } else { 850..1150 };
                assert!(expected.contains(count), "{follows:?}");
            }
        }
    }
}
