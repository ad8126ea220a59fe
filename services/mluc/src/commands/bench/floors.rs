//! What the hand-overs could cost at the least, measured right after the run with the payloads that the run had.

use std::time::Duration;

use mluc_report::{ByHop, Hop};
use mluc_transport::{Load, Payload, Settings, Way, measure};

use super::progress::Progress;

/// Before each message, so that the receiver sleeps as it does in a pipeline.
const PAUSE: Duration = Duration::from_millis(4);

/// Fills in the floors of every topic; `payload_bytes` by stage. Gives a warning when they could not be measured.
pub(super) fn add_floors(
    hops: &mut ByHop<Hop>,
    payload_bytes: [u64; 4],
    rounds: usize,
    progress: &mut Progress,
) -> Option<String> {
    let each = [
        (&mut hops.points, Payload::Points),
        (&mut hops.features, Payload::Features),
        (&mut hops.detections, Payload::Detections),
        (&mut hops.objects, Payload::Objects),
    ];
    for ((hop, payload), bytes) in each.into_iter().zip(payload_bytes) {
        hop.payload_bytes = bytes;
        if rounds == 0 {
            continue;
        }
        progress.show(
            0.5,
            &format!("floors of {}: {rounds} messages each way", payload.name()),
        );
        if let Err(cause) = add(hop, payload, rounds) {
            return Some(format!(
                "the floors under {} could not be measured: {cause}",
                payload.name()
            ));
        }
    }
    None
}

fn add(hop: &mut Hop, payload: Payload, rounds: usize) -> Result<(), String> {
    if hop.payload_bytes == 0 {
        return Err("the stage told of no payload".to_string());
    }
    let load = Load {
        payload,
        bytes: hop.payload_bytes as usize,
    };
    let settings = Settings {
        pause: PAUSE,
        ..Settings::new(load, rounds)
    };
    let measured = measure(&settings, &Way::ALL).map_err(|error| error.to_string())?;
    let of = |way: Way| measured.of(way).map(|cost| cost.latency);
    hop.alone_p50_us = of(Way::Hop).map(|latency| latency.p50_us);
    hop.alone_p99_us = of(Way::Hop).map(|latency| latency.p99_us);
    hop.raw_p50_us = of(Way::Raw).map(|latency| latency.p50_us);
    hop.raw_p99_us = of(Way::Raw).map(|latency| latency.p99_us);
    hop.socket_p50_us = of(Way::Socket).map(|latency| latency.p50_us);
    hop.futex_p50_us = of(Way::Futex).map(|latency| latency.p50_us);
    hop.memcpy_p50_us = Some(measured.memcpy.p50_us);
    Ok(())
}
