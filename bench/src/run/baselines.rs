//! What the hand-overs could cost at the least, measured right after the run with the payloads that the run had.

use std::time::Duration;

use anyhow::{Result, ensure};
use indicatif::ProgressBar;
use serde_json::{Value, json};

use super::show;
use crate::transport::{Payload, Settings, measure};

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
        payload,
        bytes: bytes as usize,
        rounds,
        warm_up: 40,
        pause: Duration::from_millis(4),
        program: None,
    };
    let [alone, raw] = measure(&settings)?;
    Ok(json!({
        "payload_bytes": bytes,
        "alone_p50_us": alone.at(0.5),
        "alone_p99_us": alone.at(0.99),
        "raw_p50_us": raw.at(0.5),
        "raw_p99_us": raw.at(0.99),
    }))
}
