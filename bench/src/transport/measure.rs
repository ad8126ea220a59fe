//! Messages in turn on every way.

use anyhow::{Result, ensure};
use mluc_geometry::Random;
use mluc_runtime::monotonic_ns;
use serde::Serialize;

use super::control::{Order, Peer};
use super::load::{Settings, Wake};
use super::percentiles::LatencyPercentiles;
use super::pin::Pin;
use super::way::{Link, Sender, Way};

/// What one way costs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Cost {
    /// From the sender's clock right before sending to the receiver's clock once the whole message is there.
    pub latency: LatencyPercentiles,
    /// How long sending keeps the sender: lending memory, sending, waking; filling apart.
    pub sender: LatencyPercentiles,
}

/// Everything measured in one run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Measured {
    /// Bytes of a message.
    pub payload_bytes: usize,
    /// How raw iceoryx2 woke.
    pub wake: Wake,
    /// By [`Way`], `None` for those not asked for.
    #[serde(serialize_with = "by_name")]
    pub ways: [Option<Cost>; 4],
    /// Copying the payload once, within one process.
    pub memcpy: LatencyPercentiles,
}

impl Measured {
    /// Of one way.
    pub fn of(&self, way: Way) -> Option<&Cost> {
        self.ways[way as usize].as_ref()
    }
}

fn by_name<S: serde::Serializer>(
    ways: &[Option<Cost>; 4],
    serializer: S,
) -> Result<S::Ok, S::Error> {
    let found = Way::ALL.into_iter().zip(ways);
    serializer.collect_map(found.filter_map(|(way, cost)| Some((way.name(), cost.as_ref()?))))
}

/// Sends in turn on every way, each time in another order, and a copy within this process.
pub fn measure(settings: &Settings, ways: &[Way]) -> Result<Measured> {
    settings.load.check()?;
    let _pin = Pin::to(settings.cores.map(|[sender, _]| sender))?;
    let order = Order {
        ways: ways.to_vec(),
        link: Link {
            load: settings.load,
            wake: settings.wake,
            label: label(),
        },
        core: settings.cores.map(|[_, receiver]| receiver),
    };
    let mut ends = vec![];
    for &way in ways {
        ends.push(End {
            way,
            sender: order.link.sender(way)?,
            latency_ns: Vec::with_capacity(settings.rounds),
            occupied_ns: Vec::with_capacity(settings.rounds),
        });
    }
    let mut peer = Peer::start(settings.program.as_deref(), &order)?;
    for end in &mut ends {
        end.sender.peer_is_ready()?;
    }
    let mut copy = Copy::new(settings.load.whole_bytes());
    for round in 0..settings.warm_up + settings.rounds {
        let counts = round >= settings.warm_up;
        for place in shuffled(ends.len(), round as u64) {
            ends[place].exchange(&mut peer, settings, round as u32, counts)?;
        }
        copy.once(round as u8, counts);
    }
    // It ends first, so that this process is the last one everywhere and removes all files.
    drop(peer);
    let mut costs = [None; 4];
    for end in ends {
        costs[end.way as usize] = Some(Cost {
            latency: LatencyPercentiles::of_ns(&end.latency_ns),
            sender: LatencyPercentiles::of_ns(&end.occupied_ns),
        });
    }
    Ok(Measured {
        payload_bytes: settings.load.whole_bytes(),
        wake: settings.wake,
        ways: costs,
        memcpy: LatencyPercentiles::of_ns(&copy.took_ns),
    })
}

/// Another order each round: a message finds the caches as the one before it left them, and no way shall always follow
/// the same other one.
fn shuffled(count: usize, round: u64) -> Vec<usize> {
    let mut places: Vec<usize> = (0..count).collect();
    Random::new(round, &[]).shuffle(&mut places);
    places
}

/// Of this measurement alone.
fn label() -> String {
    use std::sync::atomic::{AtomicU32, Ordering};
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    format!("t{}-{count}", std::process::id())
}

/// One way and what was measured on it.
struct End {
    way: Way,
    sender: Box<dyn Sender>,
    latency_ns: Vec<u64>,
    occupied_ns: Vec<u64>,
}

impl End {
    fn exchange(
        &mut self,
        peer: &mut Peer,
        settings: &Settings,
        word: u32,
        counts: bool,
    ) -> Result<()> {
        peer.expect(self.way)?;
        std::thread::sleep(settings.pause);
        let sent = self.sender.send(word)?;
        let arrived = peer.arrived()?;
        ensure!(
            arrived.sum == sent.sum,
            "{}: a sum of {} was sent, {} arrived",
            self.way.name(),
            sent.sum,
            arrived.sum
        );
        if counts {
            self.latency_ns
                .push(arrived.at_ns.saturating_sub(sent.at_ns));
            self.occupied_ns.push(sent.occupied_ns);
        }
        Ok(())
    }
}

/// One copy within this process.
struct Copy {
    from: Vec<u8>,
    to: Vec<u8>,
    took_ns: Vec<u64>,
}

impl Copy {
    fn new(bytes: usize) -> Copy {
        Copy {
            from: vec![1; bytes],
            to: vec![2; bytes],
            took_ns: vec![],
        }
    }

    fn once(&mut self, value: u8, counts: bool) {
        self.from.fill(value);
        let begun_ns = monotonic_ns();
        self.to
            .copy_from_slice(std::hint::black_box(self.from.as_slice()));
        std::hint::black_box(self.to.as_slice());
        if counts {
            self.took_ns.push(monotonic_ns() - begun_ns);
        }
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
            let mut sorted = order.clone();
            sorted.sort_unstable();
            assert_eq!(sorted, [0, 1, 2, 3]);
            for pair in order.windows(2) {
                follows[pair[0]][pair[1]] += 1;
            }
        }
        for (a, row) in follows.iter().enumerate() {
            for (b, &count) in row.iter().enumerate() {
                assert!(a == b || (850..1150).contains(&count), "{follows:?}");
            }
        }
    }
}
