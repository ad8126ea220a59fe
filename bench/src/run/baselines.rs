//! What the hand-overs could cost at the least, measured right after the run with the payloads that the run had.

use std::time::Duration;

use anyhow::{Result, ensure};
use indicatif::ProgressBar;

use super::show;
use crate::report::HandOver;
use crate::transport::{Load, Payload, Settings, Way, measure};

/// Before each message, so that the receiver sleeps as it does in a pipeline.
const PAUSE: Duration = Duration::from_millis(4);

/// Fills in the baselines of every topic; `payload_bytes` by stage. Gives a warning when they could not be measured.
pub(crate) fn add_baselines(
    hops: &mut [HandOver; 4],
    payload_bytes: [u64; 4],
    rounds: usize,
    progress: &ProgressBar,
) -> Option<String> {
    for ((hop, payload), bytes) in hops.iter_mut().zip(Payload::ALL).zip(payload_bytes) {
        hop.payload_bytes = bytes;
        if rounds == 0 {
            continue;
        }
        let topic = payload.topic().name;
        let text = format!("baselines of {topic}: {rounds} messages each way");
        show(progress, 0.5, text);
        if let Err(cause) = add(hop, payload, rounds) {
            return Some(format!(
                "the baselines of {topic} could not be measured: {cause}"
            ));
        }
    }
    None
}

fn add(hop: &mut HandOver, payload: Payload, rounds: usize) -> Result<()> {
    ensure!(
        hop.payload_bytes > 0,
        "the stage sent no heartbeat with a payload"
    );
    let load = Load {
        payload,
        bytes: hop.payload_bytes as usize,
    };
    let settings = Settings {
        pause: PAUSE,
        ..Settings::new(load, rounds)
    };
    let measured = measure(&settings, &Way::ALL)?;
    let p50_us = |way| measured.latency(way).map(|latency| latency.p50_us);
    let p99_us = |way| measured.latency(way).map(|latency| latency.p99_us);
    hop.alone_p50_us = p50_us(Way::Hop);
    hop.alone_p99_us = p99_us(Way::Hop);
    hop.raw_p50_us = p50_us(Way::Raw);
    hop.raw_p99_us = p99_us(Way::Raw);
    hop.socket_p50_us = p50_us(Way::Socket);
    hop.futex_p50_us = p50_us(Way::Futex);
    hop.memcpy_p50_us = Some(measured.memcpy.p50_us);
    Ok(())
}
