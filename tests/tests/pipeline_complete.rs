//! Frames go through four processes and come out: all of them, in order, nothing copied, nothing left behind.

use std::path::Path;
use std::time::Duration;

use mluc_ipc_types::Stage;
use mluc_runtime::{Instance, Shell, Shutdown};
use mluc_tests::{Finished, Pipeline, Setting, car_scan, leftovers, unique_instance};
use rustix::process::Signal;

#[test]
fn all_frames_come_out_in_order() {
    let run = Setting::new("order", 12).run(&[]);
    assert_eq!(run.code, Some(0), "{}", run.log);
    let expected: Vec<String> = (0..12).map(|number| format!("{number:06}")).collect();
    assert_eq!(run.frames(), expected);
    for (number, line) in run.lines.iter().enumerate() {
        assert_eq!(
            (&line["wire"], &line["sequence"]),
            (&mluc_ipc_types::WIRE_VERSION.into(), &number.into())
        );
        assert!(line["latency_us"].as_u64().unwrap() > 0);
        for stage in ["ingest", "backbone", "head", "refiner"] {
            assert!(line["stages"][stage]["run_us"].is_u64(), "{line}");
        }
    }
    let objects: usize = run
        .lines
        .iter()
        .map(|line| line["objects"].as_array().unwrap().len())
        .sum();
    assert!(
        objects > 0,
        "the untrained model finds nothing: the refiner had no work"
    );
    assert!(run.log.contains("12 in, 12 out, 0 lost"), "{}", run.log);
}

#[test]
fn the_same_scans_give_the_same_objects_whatever_the_threads() {
    let setting = Setting::new("threads", 3);
    let runs = ["1", "3"].map(|threads| setting.run(&[&format!("--threads=backbone={threads}")]));
    let objects = |run: &Finished| {
        run.lines
            .iter()
            .map(|line| (line["objects"].clone(), line["suppressed"].clone()))
            .collect::<Vec<_>>()
    };
    assert_eq!(objects(&runs[0]).len(), 3);
    assert_eq!(objects(&runs[0]), objects(&runs[1]));
}

#[test]
fn frames_are_late_when_a_budget_is_set_and_passed_alone() {
    let setting = Setting::new("late", 2);
    let late = |more: &[&str]| {
        let run = setting.run(more);
        assert_eq!(run.frames().len(), 2, "{}", run.log);
        ["000000", "000001"].map(|frame| run.flags(frame).contains(&"late"))
    };
    assert_eq!(late(&[]), [false; 2], "pace complete has no budget");
    assert_eq!(late(&["--budget-ms", "0"]), [true; 2]);
}

#[test]
fn at_the_sensors_pace_frames_come_at_its_rate() {
    // Slow enough for a loaded machine: a frame that is lost is another test's matter.
    let run = Setting::new("sensor", 10).run(&["--pace", "sensor", "--rate", "4"]);
    let sequences: Vec<u64> = run
        .lines
        .iter()
        .map(|line| line["sequence"].as_u64().unwrap())
        .collect();
    assert!(
        sequences.is_sorted() && sequences.last() == Some(&9),
        "{sequences:?} {}",
        run.log
    );
    let lost = 10 - sequences.len();
    assert_eq!(run.code, Some(if lost == 0 { 0 } else { 3 }), "{}", run.log);
    let stamps: Vec<u64> = run
        .lines
        .iter()
        .map(|line| line["stamp_ns"].as_u64().unwrap())
        .collect();
    let seconds = (stamps[stamps.len() - 1] - stamps[0]) as f64 * 1e-9;
    let expected = (sequences[sequences.len() - 1] - sequences[0]) as f64 / 4.0;
    assert!(
        (seconds - expected).abs() < 0.4,
        "{seconds} s instead of {expected} s"
    );
}

#[test]
fn two_pipelines_run_side_by_side() {
    let settings = ["left", "right"].map(|name| Setting::new(name, 5));
    let runs = settings.each_ref().map(|setting| setting.up(&[]));
    for (setting, run) in settings.iter().zip(runs) {
        let run = setting.finish(run);
        assert_eq!((run.code, run.frames().len()), (Some(0), 5), "{}", run.log);
    }
}

fn stage(name: &str, instance: &str, model: &Path, input: &Path) -> Pipeline {
    let paths = [model, input].map(|path| path.display().to_string());
    let mut arguments = vec!["stage", name, "--instance", instance, "--model", &paths[0]];
    if name == "ingest" {
        arguments.extend(["--input", &paths[1], "--pace", "complete"]);
    }
    Pipeline::start(arguments)
}

#[test]
fn stages_start_in_any_order_and_say_what_they_wait_for() {
    let Setting {
        folder: _folder,
        model,
        input,
        ..
    } = Setting::new("any", 4);
    for order in [
        ["ingest", "refiner", "head", "backbone"],
        ["head", "backbone", "ingest", "refiner"],
    ] {
        let instance = unique_instance("any");
        let mut stages: Vec<Pipeline> = Vec::new();
        for name in order {
            stages.push(stage(name, &instance, &model, &input));
            std::thread::sleep(Duration::from_millis(100));
        }
        let place = order.iter().position(|name| *name == "ingest").unwrap();
        let ingest = stages.remove(place).finish();
        assert_eq!(ingest.code, Some(0), "{}", ingest.log);
        for stage in stages {
            stage.signal(Signal::TERM);
            let ended = stage.finish_within(Duration::from_secs(1));
            assert_eq!(ended.code, Some(0), "{}", ended.log);
        }
        assert_eq!(leftovers(&instance), [""; 0]);
    }
    let instance = unique_instance("wait");
    let mut alone = stage("ingest", &instance, &model, &input);
    alone.wait_until("it says so", |p| {
        p.log()
            .contains("waiting for backbone, head, refiner to be ready")
    });
    let mut head = stage("head", &instance, &model, &input);
    head.wait_until("it says so", |p| {
        p.log()
            .contains("waiting for features: no producer is running")
    });
}

/// Each stage looks up every payload that it is given in its own `/proc/self/maps`; the bytes that cross shared memory
/// are counted.
#[test]
fn payloads_are_read_where_they_lie_and_written_once() {
    let scan_bytes = car_scan(8.0).len() as u64 * 16;
    let setting = Setting::new("copy", 1);
    let mut run = setting.up(&["--loop", "--verify-mapping"]);
    run.wait_until("frames flow", |p| p.line_count() > 5);

    let instance = Instance::new(&setting.instance).unwrap();
    let shell = Shell::observer(&instance, None, Shutdown::manual()).unwrap();
    let mut watch = shell.health_watch().unwrap();
    while !Stage::ALL.iter().all(|&stage| watch.is_ready(stage)) {
        watch.update().unwrap();
        std::thread::sleep(Duration::from_millis(10));
    }
    let of = |stage: Stage| *watch.of(stage).unwrap();
    let (ingest, backbone, head, refiner) = (
        of(Stage::Ingest),
        of(Stage::Backbone),
        of(Stage::Head),
        of(Stage::Refiner),
    );
    assert_eq!(
        u64::from(ingest.bytes_written),
        scan_bytes,
        "the scan enters once"
    );
    assert_eq!(backbone.bytes_read, scan_bytes, "and is read in full");
    assert_eq!(
        head.bytes_read,
        u64::from(backbone.bytes_written),
        "the head reads what the backbone wrote"
    );
    assert_eq!(
        refiner.bytes_read,
        scan_bytes + u64::from(head.bytes_written)
    );
    for stage in [backbone, head, refiner] {
        assert!(
            stage.frames_in > 0 && stage.mappings_verified >= stage.frames_in,
            "{stage:?}"
        );
    }
    drop((watch, shell));
    run.signal(Signal::TERM);
    assert_eq!(run.finish().code, Some(0));
}
