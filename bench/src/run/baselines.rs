//! What the hand-overs could cost at the least, measured right after the run with the payloads that the run had.

use std::time::Duration;

use anyhow::{Result, ensure};
use indicatif::ProgressBar;

use super::show;
use crate::report::{Baselines, HandOver};
use crate::transport::{Payload, Settings, Way, measure};

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
        match baselines(payload, bytes as usize, rounds) {
            Ok(found) => hop.baselines = found,
            Err(cause) => {
                let text = format!("the baselines of {topic} could not be measured: {cause}");
                return Some(text);
            }
        }
    }
    None
}

fn baselines(payload: Payload, bytes: usize, rounds: usize) -> Result<Baselines> {
    ensure!(bytes > 0, "the stage sent no heartbeat with a payload");
    let settings = Settings {
        bytes,
        pause: PAUSE,
        ..Settings::new(payload, rounds)
    };
    let measured = measure(&settings, &Way::ALL)?;
    let [alone, raw, futex, socket] = Way::ALL.map(|way| measured.latency(way));
    Ok(Baselines {
        alone_p50_us: alone.map(|alone| alone.p50_us),
        alone_p99_us: alone.map(|alone| alone.p99_us),
        raw_p50_us: raw.map(|raw| raw.p50_us),
        raw_p99_us: raw.map(|raw| raw.p99_us),
        socket_p50_us: socket.map(|socket| socket.p50_us),
        futex_p50_us: futex.map(|futex| futex.p50_us),
        memcpy_p50_us: Some(measured.memcpy.p50_us),
    })
}
