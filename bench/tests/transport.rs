//! Real messages between real processes; figures are not judged here, only their sense.

use std::path::PathBuf;
use std::time::Duration;

use mluc_bench::transport::{Latencies, Payload, Settings, measure};

fn settings(payload: Payload, bytes: usize) -> Settings {
    Settings {
        payload,
        bytes,
        rounds: 25,
        warm_up: 3,
        pause: Duration::from_micros(300),
        program: Some(PathBuf::from(env!("CARGO_BIN_EXE_mluc-bench"))),
    }
}

fn largest_bytes(payload: Payload) -> usize {
    let topic = payload.topic();
    topic.elements_max * topic.element_bytes
}

/// What this test's measurements leave in shared memory. Their names hold the process id.
fn leftovers() -> Vec<String> {
    let own = format!("t{}-", std::process::id());
    std::fs::read_dir("/dev/shm")
        .unwrap()
        .flatten()
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .filter(|name| name.contains(&own))
        .collect()
}

/// One test, so that no measurement runs beside another.
#[test]
fn every_way_carries_every_payload_and_leaves_nothing() {
    for payload in Payload::ALL {
        let bytes = largest_bytes(payload).min(2_000_000);
        measure(&settings(payload, bytes))
            .unwrap()
            .iter()
            .for_each(sensible);
    }
    refusals();
    assert_eq!(leftovers(), Vec::<String>::new());
}

fn sensible(latencies: &Latencies) {
    let [p50_us, p99_us] = [0.5, 0.99].map(|q| latencies.at(q));
    assert_eq!(latencies.count(), 25);
    assert!((0.1..1e6).contains(&p50_us) && p50_us <= p99_us);
}

fn refusals() {
    let error = |settings: &Settings| format!("{:#}", measure(settings).unwrap_err());
    let largest = largest_bytes(Payload::Points);
    for bytes in [0, largest + 1] {
        let wrong = settings(Payload::Points, bytes);
        assert!(error(&wrong).contains(&format!("1 to {largest} bytes")));
    }
    // A program that does not call `serve_peer` says nothing, and is noticed.
    let other = Settings {
        program: Some(PathBuf::from("/bin/true")),
        ..settings(Payload::Detections, 1000)
    };
    assert!(error(&other).contains("the receiving process is gone"));
}
