//! Figures of all topics, their ratios, and what all hops of a frame take together.

use std::collections::BTreeMap;

use mluc_bench::machine::Machine;
use mluc_transport::{Cost, Measured, Payload, Percentiles, Way};
use serde::Serialize;

/// A frame at 10 Hz, us.
const FRAME_US: f64 = 100_000.0;

/// Everything, for a program.
#[derive(Serialize)]
pub(crate) struct Report {
    machine: Machine,
    /// How this process is scheduled: `other` or `realtime`; the receiver has the same.
    scheduling: &'static str,
    topics: BTreeMap<&'static str, Topic>,
    all_hops: AllHops,
}

#[derive(Serialize)]
struct Topic {
    #[serde(flatten)]
    measured: Measured,
    ratios: Ratios,
}

/// Ours over a floor; below it our hop is not to be expected.
#[derive(Clone, Copy, Debug, Serialize)]
struct Ratios {
    hop_over_raw_p50: f64,
    hop_over_raw_p99: f64,
    hop_over_futex_p50: f64,
    /// The copy over ours: how often a message could be handed over meanwhile.
    socket_over_hop_p50: f64,
    memcpy_over_hop_p50: f64,
}

/// The frame's way from ingest to the robot: one message of each topic, as large as it can be.
#[derive(Serialize)]
struct AllHops {
    p50_us: f64,
    p99_us: f64,
    /// Of a frame of 100 ms, percent.
    p50_percent: f64,
    p99_percent: f64,
}

impl Report {
    pub(crate) fn of(measured: &[(Payload, Measured)]) -> Report {
        let hop = |measured: &Measured| latency(measured, Way::Hop);
        let sum = |pick: fn(Percentiles) -> f64| -> f64 {
            measured.iter().map(|(_, found)| pick(hop(found))).sum()
        };
        let (p50_us, p99_us) = (sum(|hop| hop.p50_us), sum(|hop| hop.p99_us));
        let topics = measured.iter().map(|&(payload, measured)| {
            let topic = Topic {
                measured,
                ratios: ratios(&measured),
            };
            (payload.name(), topic)
        });
        Report {
            machine: Machine::here(),
            scheduling: scheduling(),
            topics: topics.collect(),
            all_hops: AllHops {
                p50_us,
                p99_us,
                p50_percent: 100.0 * p50_us / FRAME_US,
                p99_percent: 100.0 * p99_us / FRAME_US,
            },
        }
    }

    pub(crate) fn print(&self) {
        println!(
            "{}, {} cores, load {:.1}, scheduling {}",
            self.machine.cpu, self.machine.cores, self.machine.load_1min, self.scheduling
        );
        println!(
            "{:<12} {:>10} {:<7} {:>10} {:>10} {:>10} {:>10} {:>12}",
            "topic", "bytes", "way", "p50 us", "p90 us", "p99 us", "max us", "sender p50"
        );
        for (name, topic) in &self.topics {
            let measured = &topic.measured;
            for way in Way::ALL {
                let Some(Cost { latency, sender }) = measured.of(way) else {
                    continue;
                };
                print_row(
                    (name, measured.payload_bytes),
                    way.name(),
                    latency,
                    sender.p50_us,
                );
            }
            let copy = &measured.memcpy;
            print_row((name, measured.payload_bytes), "memcpy", copy, copy.p50_us);
            let found = &topic.ratios;
            println!(
                "{:<12} hop/raw p50 {:.2} p99 {:.2}; hop/futex p50 {:.2}; socket/hop p50 {:.1}; memcpy/hop p50 {:.2}",
                "",
                found.hop_over_raw_p50,
                found.hop_over_raw_p99,
                found.hop_over_futex_p50,
                found.socket_over_hop_p50,
                found.memcpy_over_hop_p50
            );
        }
        println!(
            "all hops of a frame: p50 {:.0} us, {:.2} % of 100 ms; p99 {:.0} us, {:.2} %",
            self.all_hops.p50_us,
            self.all_hops.p50_percent,
            self.all_hops.p99_us,
            self.all_hops.p99_percent
        );
    }
}

fn print_row((name, bytes): (&str, usize), way: &str, of: &Percentiles, sender_us: f64) {
    println!(
        "{name:<12} {bytes:>10} {way:<7} {:>10.2} {:>10.2} {:>10.2} {:>10.2} {sender_us:>12.2}",
        of.p50_us, of.p90_us, of.p99_us, of.max_us
    );
}

fn latency(measured: &Measured, way: Way) -> Percentiles {
    let cost = measured.of(way);
    cost.map_or_else(Percentiles::default, |cost| cost.latency)
}

fn ratios(measured: &Measured) -> Ratios {
    let [hop, raw, futex, socket] = Way::ALL.map(|way| latency(measured, way));
    Ratios {
        hop_over_raw_p50: hop.p50_us / raw.p50_us,
        hop_over_raw_p99: hop.p99_us / raw.p99_us,
        hop_over_futex_p50: hop.p50_us / futex.p50_us,
        socket_over_hop_p50: socket.p50_us / hop.p50_us,
        memcpy_over_hop_p50: measured.memcpy.p50_us / hop.p50_us,
    }
}

/// By the kernel's own word: field 41 of `/proc/self/stat`, 0 for time sharing.
fn scheduling() -> &'static str {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let after_name = stat.rsplit(')').next().unwrap_or_default();
    match after_name.split_whitespace().nth(38) {
        Some("1" | "2") => "realtime",
        _ => "other",
    }
}
