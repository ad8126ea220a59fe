//! Our hop between two processes and its baseline, interleaved in one run, as one JSON object.
//!
//! For each topic: raw iceoryx2 with the same payload, queue settings and wake-up. On a machine with other work, run it
//! as `chrt -f 50 target/release/transport` and read ratios, not microseconds.

use anyhow::Result;
use clap::Parser;
use mluc_bench::machine::describe_here;
use mluc_bench::transport::{Measured, Payload, Settings, measure, serve_peer};
use serde_json::{Map, Value, json};

/// A frame at 10 Hz, us.
const FRAME_US: f64 = 100_000.0;

#[derive(Parser)]
struct Arguments {
    /// Messages each way, for each topic. 36 MB messages: a quarter as many.
    #[arg(long, default_value_t = 2000)]
    rounds: usize,
}

fn main() -> Result<()> {
    if serve_peer()? {
        return Ok(());
    }
    let arguments = Arguments::parse();
    let mut measured = vec![];
    for payload in Payload::ALL {
        let rounds = match payload {
            Payload::Features => arguments.rounds.div_ceil(4),
            _ => arguments.rounds,
        };
        measured.push((payload, measure(&Settings::new(payload, rounds))?));
    }
    println!("{:#}", report(&measured)?);
    Ok(())
}

fn report(measured: &[(Payload, Measured)]) -> Result<Value> {
    let mut topics = Map::new();
    for (payload, found) in measured {
        let mut topic = serde_json::to_value(found)?;
        topic["ratios"] = ratios(found).into_iter().collect();
        topics.insert(payload.topic().name.to_string(), topic);
    }
    let (p50_us, p99_us) = all_hops_us(measured);
    Ok(json!({
        "machine": describe_here(),
        // The receiver has the same.
        "scheduling": scheduling(),
        "topics": topics,
        "all_hops": {
            "p50_us": p50_us,
            "p99_us": p99_us,
            "p50_percent": 100.0 * p50_us / FRAME_US,
            "p99_percent": 100.0 * p99_us / FRAME_US,
        },
    }))
}

/// The frame's way from ingest to the robot: one message of each topic, as large as it can be; p50 and p99.
fn all_hops_us(measured: &[(Payload, Measured)]) -> (f64, f64) {
    let hops = measured.iter().map(|(_, found)| found.latencies()[0]);
    hops.fold((0.0, 0.0), |sum, hop| {
        (sum.0 + hop.p50_us, sum.1 + hop.p99_us)
    })
}

/// Ours over iceoryx2 alone, below which our hop is not to be expected.
fn ratios(found: &Measured) -> [(String, f64); 2] {
    let [hop, raw] = found.latencies();
    [
        ("hop_over_raw_p50", hop.p50_us / raw.p50_us),
        ("hop_over_raw_p99", hop.p99_us / raw.p99_us),
    ]
    .map(|(name, ratio)| (name.to_string(), ratio))
}

/// By the kernel's own word: field 41 of `/proc/self/stat`, 0 for time sharing.
fn scheduling() -> &'static str {
    let stat = procfs::process::Process::myself().and_then(|own| own.stat());
    match stat.map(|stat| stat.policy) {
        Ok(Some(1 | 2)) => "realtime",
        _ => "other",
    }
}
