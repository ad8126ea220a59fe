//! What the hand-overs could cost at the least, measured right after the run with the payloads that the run had.

use std::time::Duration;

use anyhow::{Result, ensure};
use indicatif::ProgressBar;
use serde_json::{Value, json};

use super::show;
use crate::transport::{Payload, Settings, measure};

/// Before each message, so that the receiver sleeps as it does in a pipeline.
const PAUSE: Duration = Duration::from_millis(4);

/// By topic the payload, and with `rounds` its baselines; and a warning when they could not be measured.
pub(crate) fn baselines(
    payload_bytes: [u64; 4],
    rounds: usize,
    progress: &ProgressBar,
) -> (Value, Option<String>) {
    let (mut found, mut warning) = (json!({}), None);
    for (payload, bytes) in Payload::ALL.into_iter().zip(payload_bytes) {
        let topic = payload.topic().name;
        found[topic] = json!({"payload_bytes": bytes});
        if rounds == 0 || warning.is_some() {
            continue;
        }
        let text = format!("baselines of {topic}: {rounds} messages each way");
        show(progress, 0.5, text);
        match of_topic(payload, bytes, rounds) {
            Ok(own) => found[topic] = own,
            Err(cause) => {
                let text = format!("the baselines of {topic} could not be measured: {cause}");
                warning = Some(text);
            }
        }
    }
    (found, warning)
}

fn of_topic(payload: Payload, bytes: u64, rounds: usize) -> Result<Value> {
    ensure!(bytes > 0, "the stage sent no heartbeat with a payload");
    let settings = Settings {
        bytes: bytes as usize,
        pause: PAUSE,
        ..Settings::new(payload, rounds)
    };
    let measured = measure(&settings)?;
    let [alone, raw] = measured.latencies();
    Ok(json!({
        "payload_bytes": bytes,
        "alone_p50_us": alone.p50_us,
        "alone_p99_us": alone.p99_us,
        "raw_p50_us": raw.p50_us,
        "raw_p99_us": raw.p99_us,
    }))
}
