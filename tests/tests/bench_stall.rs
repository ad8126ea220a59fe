//! A stall counts for every frame that it delays, not only for the frame that met it (no coordinated omission).

use mluc_ipc_types::Stage;
use mluc_tests::{Setting, read_json, send_signal};
use rustix::process::Signal;
use serde_json::Value;
use std::{path::Path, time::Duration};

const RATE_HZ: f64 = 20.0;
const STALL: Duration = Duration::from_millis(1500);

/// A run of 6 s in which a stage is stopped for [`STALL`]; returns the report and the measured latencies, us.
fn stalled(stage: &str) -> (Value, Vec<f64>) {
    let setting = Setting::new("bench", 3);
    // Without this setting a stop of this length is a hang, and the stage would be killed.
    let config = setting.config(&format!("[stages.{stage}]\nheartbeat_max_ms = 0\n"));
    let config = config.replace("--config", "--scenario");
    let options = format!("--rate {RATE_HZ} --seconds 6 --warm-up 0 {config}");
    let mut run = setting.start_bench(&options);
    run.wait_until("all stages run", |run| run.stages().len() == 4);
    let instance = format!("b-{}-0", run.pid());
    // This wait places the stall within the 6 s.
    run.wait_for_health(&instance, "ten frames are through", |watch| {
        watch.of(Stage::Refiner).is_some_and(|health| health.frames_out >= 10)
    });
    let process = run.stage(stage);
    send_signal(process, Signal::STOP);
    std::thread::sleep(STALL);
    send_signal(process, Signal::CONT);
    run.finish_within(Duration::from_secs(120)).assert_ended_well();
    let out = setting.report();
    (read_json(&out.join("report.json")), latencies_us(&out))
}

fn latencies_us(out: &Path) -> Vec<f64> {
    let text = std::fs::read_to_string(out.join("frames.csv")).unwrap();
    let latency_us = |line: &str| line.split(',').nth(19).unwrap().parse().unwrap();
    text.lines().skip(1).map(latency_us).collect()
}

/// Frames due during a stall of length S wait between 0 and S, evenly spread: frames due in its first (1 - `share`) S wait longer than `share` S.
fn assert_counted(latencies_us: &[f64], stage: &str) {
    for share in [0.25, 0.5, 0.75] {
        let limit_us = share * STALL.as_secs_f64() * 1e6;
        let late = latencies_us.iter().filter(|&&us| us > limit_us).count() as f64;
        let expected = (1.0 - share) * STALL.as_secs_f64() * RATE_HZ;
        let what = format!("{stage}: {late} frames later than {limit_us} us");
        assert!(late >= 0.8 * expected, "{what}, expected {expected}");
    }
}

#[test]
fn a_stage_that_stands_still_delays_all_frames_that_were_due() {
    let (report, latencies_us) = stalled("backbone");
    assert_counted(&latencies_us, "backbone");
    let dropped = report["frames"]["dropped"].as_f64().unwrap();
    assert!(dropped > 0.5 * STALL.as_secs_f64() * RATE_HZ, "newer frames overtook them: {dropped}");
    // A measurement of only the frames that came out would miss the stall at its 90th percentile.
    let p90_us = report["end_to_end_us"]["p90"].as_f64().unwrap();
    assert!(p90_us > 0.2e6, "{p90_us}");
    let warnings = report["warnings"].to_string();
    assert!(warnings.contains("were dropped"), "{warnings}");
}

#[test]
fn a_source_that_stands_still_does_not_move_the_time_that_frames_were_due() {
    let (_, latencies_us) = stalled("ingest");
    assert_counted(&latencies_us, "ingest");
}
