//! Real messages between real processes; figures are not judged here, only their sense.

use std::path::PathBuf;
use std::time::Duration;

use mluc_bench::transport::{Measured, Payload, Settings, measure};

fn settings(payload: Payload) -> Settings {
    Settings {
        warm_up: 3,
        pause: Duration::from_micros(300),
        program: Some(PathBuf::from(env!("CARGO_BIN_EXE_mluc-bench"))),
        ..Settings::new(payload, 25)
    }
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
        let mut settings = settings(payload);
        if payload == Payload::Features {
            settings.bytes = 1_000_000;
        }
        let measured = measure(&settings).unwrap();
        sensible(&measured);
    }
    refusals();
    assert_eq!(leftovers(), Vec::<String>::new());
}

fn sensible(measured: &Measured) {
    for latency in measured.latencies() {
        assert_eq!(latency.count, 25);
        assert!((0.1..1e6).contains(&latency.p50_us), "{latency:?}");
        assert!(latency.p50_us <= latency.p99_us);
    }
    let json = serde_json::to_value(measured).unwrap();
    assert!(json["ways"]["hop"]["latency"]["p50_us"].is_number());
}

fn refusals() {
    let error = |settings: &Settings| format!("{:#}", measure(settings).unwrap_err());
    let largest = Payload::Points.largest_bytes();
    for bytes in [0, largest + 1] {
        let wrong = Settings {
            bytes,
            ..settings(Payload::Points)
        };
        assert!(error(&wrong).contains(&format!("1 to {largest} bytes")));
    }
    // A program that does not call `serve_peer` says nothing, and is noticed.
    let other = Settings {
        program: Some(PathBuf::from("/bin/true")),
        ..settings(Payload::Detections)
    };
    assert!(error(&other).contains("the receiving process is gone"));
}
