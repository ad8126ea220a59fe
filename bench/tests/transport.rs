//! Real messages between real processes; figures are not judged here, only their sense.

use std::path::PathBuf;
use std::time::Duration;

use mluc_bench::transport::{Load, Measured, Payload, Settings, Wake, Way, measure};

fn settings(load: Load) -> Settings {
    Settings {
        warm_up: 3,
        pause: Duration::from_micros(300),
        program: Some(PathBuf::from(env!("CARGO_BIN_EXE_mluc-bench"))),
        ..Settings::new(load, 25)
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
    let points = Load::largest(Payload::Points);
    let features = Load {
        payload: Payload::Features,
        bytes: 1_000_000,
    };
    let [detections, objects] = [Payload::Detections, Payload::Objects].map(Load::largest);
    for load in [points, features, detections, objects] {
        let measured = measure(&settings(load), &Way::ALL).unwrap();
        sensible(&measured);
    }
    // A copy of 2 MB takes longer than handing it over; that is what the copy-free way is for.
    let copied = measure(&settings(points), &[Way::Socket]).unwrap();
    let socket = copied.latency(Way::Socket).unwrap();
    assert!(socket.p50_us > copied.memcpy.p50_us, "{copied:?}");
    let polled = Settings {
        wake: Wake::Poll,
        ..settings(points)
    };
    let polled = measure(&polled, &[Way::Raw]).unwrap();
    assert!(polled.latency(Way::Raw).unwrap().p50_us > 0.0);
    assert!(polled.latency(Way::Hop).is_none());

    refusals();
    assert_eq!(leftovers(), Vec::<String>::new());
}

fn sensible(measured: &Measured) {
    for way in Way::ALL {
        let latency = measured.latency(way).unwrap();
        assert_eq!(latency.count, 25);
        assert!((0.1..1e6).contains(&latency.p50_us), "{way:?}: {latency:?}");
        assert!(latency.p50_us <= latency.p99_us);
    }
    let json = serde_json::to_value(measured).unwrap();
    assert!(json["ways"]["hop"]["latency"]["p50_us"].is_number());
}

fn refusals() {
    let error = |settings: &Settings| format!("{:#}", measure(settings, &Way::ALL).unwrap_err());
    let largest = Load::largest(Payload::Points);
    for bytes in [0, largest.bytes + 1] {
        let wrong = Load { bytes, ..largest };
        let expected = format!("1 to {} bytes", largest.bytes);
        assert!(error(&settings(wrong)).contains(&expected));
    }
    // A program that does not call `serve_peer` says nothing, and is noticed.
    let other = Settings {
        program: Some(PathBuf::from("/bin/true")),
        ..settings(Load::largest(Payload::Detections))
    };
    assert!(error(&other).contains("the receiving process is gone"));
}
