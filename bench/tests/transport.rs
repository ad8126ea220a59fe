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
    for load in [
        Load::POINTS,
        Load::DETECTIONS,
        Load::OBJECTS,
        Load {
            payload: Payload::Features,
            bytes: 1_000_000,
        },
    ] {
        let measured = measure(&settings(load), &Way::ALL).unwrap();
        sensible(&measured);
    }
    // A copy of 2 MB takes longer than handing it over; that is what the copy-free way is for.
    let points = measure(&settings(Load::POINTS), &[Way::Socket]).unwrap();
    let socket = points.of(Way::Socket).unwrap().latency;
    assert!(socket.p50_us > points.memcpy.p50_us, "{points:?}");
    let polled = Settings {
        wake: Wake::Poll,
        ..settings(Load::POINTS)
    };
    let polled = measure(&polled, &[Way::Raw]).unwrap();
    assert!(polled.of(Way::Raw).unwrap().latency.p50_us > 0.0);
    assert!(polled.of(Way::Hop).is_none());

    refusals();
    assert_eq!(leftovers(), Vec::<String>::new());
}

fn sensible(measured: &Measured) {
    for way in Way::ALL {
        let cost = measured.of(way).unwrap();
        assert_eq!(cost.latency.count, 25);
        assert!(cost.latency.p50_us > 0.1, "{way:?}: {cost:?}");
        assert!(cost.latency.p50_us < 1e6, "{way:?}: {cost:?}");
        assert!(cost.latency.p50_us <= cost.latency.p99_us);
    }
    let json = serde_json::to_value(measured).unwrap();
    assert!(json["ways"]["hop"]["latency"]["p50_us"].is_number());
}

fn refusals() {
    let too_long = Load {
        payload: Payload::Points,
        bytes: Load::POINTS.bytes + 1,
    };
    let error = |settings: &Settings| format!("{:#}", measure(settings, &Way::ALL).unwrap_err());
    assert!(error(&settings(too_long)).contains(&format!("1 to {} bytes", Load::POINTS.bytes)));
    // A program that does not call `serve_peer` says nothing, and is noticed.
    let other = Settings {
        program: Some(PathBuf::from("/bin/true")),
        ..settings(Load::DETECTIONS)
    };
    assert!(error(&other).contains("the receiving process is gone"));
}
