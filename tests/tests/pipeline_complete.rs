//! All frames pass through four processes and come out in order; nothing is copied, nothing is left behind.

use mluc_ipc_types::{Stage, WIRE_VERSION};
use mluc_tests::{Finished, Running, Setting, car_scan, leftovers, mluc_program, unique_instance};
use rustix::process::Signal;
use serde_json::Value;
use std::{process::Command, time::Duration};

#[test]
fn all_frames_come_out_in_order() {
    let run = Setting::new("order", 12).run("");
    run.assert_complete(0, 12);
    run.assert_says(&["12 in, 12 out, 0 lost"]);
    for (number, line) in run.lines.iter().enumerate() {
        assert_eq!(line["frame"], format!("{number:06}"));
        assert_eq!(line["wire"], WIRE_VERSION);
        assert!(line["latency_us"].as_u64().unwrap() > 0);
        let stamp_ns = |line: &Value| line["stamp_ns"].as_u64().unwrap();
        let since_ns = stamp_ns(line) - stamp_ns(&run.lines[0]);
        assert_eq!(since_ns, number as u64 * 100_000_000);
        for stage in Stage::ALL {
            assert!(line["stages"][stage.name()]["run_us"].is_u64(), "{line}");
        }
    }
    let mut objects = run.lines.iter().flat_map(|line| line["objects"].as_array().unwrap());
    assert!(objects.next().is_some(), "the refiner had no work");
}

#[test]
fn a_file_on_standard_input_is_an_input() {
    let setting = Setting::new("stdin", 1);
    let (program, model) = (mluc_program(), &setting.model);
    let up = format!("up --pace complete --instance {} --model", setting.instance);
    let scan = setting.input.join("000000.bin");
    let script = format!(
        "cat {} | {} {up} {} --input -",
        scan.display(),
        program.display(),
        model.display()
    );
    let run = Running::start(Command::new("sh").args(["-c", &script])).finish();
    run.assert_complete(0, 1);
    let objects = |run: &Finished| run.lines[0]["objects"].clone();
    assert_eq!(objects(&run), objects(&setting.run("")));
    let mut none = Command::new(program);
    Running::start(none.args(["up", "--input", "-"])).finish().assert_ended(1, 0);
}

#[test]
fn frames_are_late_when_a_budget_is_set_and_passed_alone() {
    let setting = Setting::new("late", 2);
    let late = |options: &str| {
        let run = setting.run(options);
        ["000000", "000001"].map(|frame| run.flags(frame).contains(&"late"))
    };
    assert_eq!(late(""), [false; 2], "pace complete has no budget");
    assert_eq!(late("--budget-ms 0"), [true; 2]);
}

#[test]
fn at_the_sensors_pace_frames_come_at_its_rate() {
    // The rate is slow enough for a loaded machine: other tests cover lost frames.
    let run = Setting::new("sensor", 10).run("--pace sensor --rate 4");
    let sequences = run.sequences();
    let (first, last) = (sequences[0], sequences[sequences.len() - 1]);
    assert!(sequences.is_sorted() && last == 9, "{sequences:?}");
    let code = if sequences.len() == 10 { 0 } else { 3 };
    assert_eq!(run.code, Some(code), "{}", run.log);
    let stamp_ns = |line: usize| run.lines[line]["stamp_ns"].as_u64().unwrap();
    let seconds = (stamp_ns(sequences.len() - 1) - stamp_ns(0)) as f64 * 1e-9;
    let expected = (last - first) as f64 / 4.0;
    let off = (seconds - expected).abs();
    assert!(off < 0.4, "{seconds} s instead of {expected} s");
}

#[test]
fn frames_that_newer_ones_replaced_end_the_run_with_a_warning() {
    // No processor takes 2 ms for a frame.
    let run = Setting::new("replaced", 40).run("--pace sensor --rate 500");
    assert_eq!(run.code, Some(3), "{}", run.log);
    let out = run.sequences().len();
    run.assert_says(&[&format!("40 in, {out} out, {} lost", 40 - out)]);
}

#[test]
fn stages_start_in_any_order_and_say_what_they_wait_for() {
    let setting = Setting::new("any", 4);
    for order in
        [["ingest", "refiner", "head", "backbone"], ["head", "backbone", "ingest", "refiner"]]
    {
        let instance = unique_instance("any");
        let mut stages = order.map(|name| {
            let stage = setting.stage(name, &instance);
            std::thread::sleep(Duration::from_millis(100));
            (name, stage)
        });
        // Ingest ends by itself, then the other stages are asked to end.
        stages.sort_by_key(|(name, _)| *name != "ingest");
        for (name, stage) in stages {
            if name != "ingest" {
                stage.signal(Signal::TERM);
            }
            let patience = Duration::from_secs(if name == "ingest" { 60 } else { 10 });
            let ended = stage.finish_within(patience);
            assert_eq!(ended.code, Some(0), "{}", ended.log);
        }
        assert_eq!(leftovers(&instance), [""; 0]);
    }
    let instance = unique_instance("wait");
    let says = |name: &str, words: &str| {
        let mut alone = setting.stage(name, &instance);
        alone.wait_for_words(words);
        alone
    };
    let _ingest = says("ingest", "waiting for backbone, head, refiner to be ready");
    let _head = says("head", "waiting for features: no producer is running");
}

/// Each stage looks up every payload that it gets in its own `/proc/self/maps`; the bytes that cross shared memory are counted.
#[test]
fn payloads_are_read_where_they_lie_and_written_once() {
    let scan_bytes = car_scan(8.0).len() as u64 * 16;
    let setting = Setting::new("copy", 1);
    let mut run = setting.up("--loop --verify-mapping");
    run.wait_for_lines(6);
    let mut heard = vec![];
    run.wait_for_health(&setting.instance, "all stages were heard", |watch| {
        let ready = Stage::ALL.into_iter().filter(|&stage| watch.is_ready(stage));
        heard = ready.filter_map(|stage| watch.of(stage).copied()).collect();
        heard.len() == 4
    });
    let [ingest, backbone, head, refiner]: [_; 4] = heard.try_into().expect("all four");
    let written = |health: &mluc_ipc_types::Health| u64::from(health.bytes_written);
    assert_eq!(written(&ingest), scan_bytes, "the scan enters once");
    assert_eq!(backbone.bytes_read, scan_bytes, "and is read in full");
    // The head reads what the backbone has written.
    assert_eq!(head.bytes_read, written(&backbone));
    assert_eq!(refiner.bytes_read, scan_bytes + written(&head));
    for stage in [backbone, head, refiner] {
        let is_verified = stage.mappings_verified >= stage.frames_in;
        assert!(stage.frames_in > 0 && is_verified, "{stage:?}");
    }
    run.stop();
}
