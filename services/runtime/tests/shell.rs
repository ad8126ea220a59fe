//! Two processes' worth of ports in one process: each shell maps the segments itself.

use std::path::Path;
use std::time::{Duration, Instant};

use mluc_ipc_types::{FeatureBlock, FrameHeader, HealthState, Point, Stage, Topic};
use mluc_runtime::{Instance, RuntimeError, Shell, ShellOptions, Shutdown};

fn options(label: &str) -> ShellOptions {
    let name = format!("{label}-{}", std::process::id());
    let mut options = ShellOptions::new(Instance::new(&name).unwrap());
    options.verify_mapping = true;
    options
}

fn stage(options: &ShellOptions, stage: Stage) -> Shell {
    Shell::stage(options.clone(), stage, Shutdown::manual()).unwrap()
}

fn leftovers(instance: &Instance) -> Vec<String> {
    let segments = std::fs::read_dir("/dev/shm").unwrap().flatten();
    segments
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .filter(|name| {
            name.starts_with(instance.prefix())
                || Path::new("/dev/shm").join(name) == instance.root()
        })
        .collect()
}

fn send(output: &mut mluc_runtime::Output<Point>, sequence: u64, points: usize) {
    let header = FrameHeader::new(sequence, "a");
    let mut loan = output.loan(&header, points).unwrap();
    for (number, point) in loan.elements_mut().iter_mut().enumerate() {
        *point = Point {
            x_m: number as f32,
            y_m: sequence as f32,
            ..Point::default()
        };
    }
    loan.publish().unwrap();
}

#[test]
fn a_message_is_written_once_and_read_where_it_lies() {
    let options = options("zero");
    let mut producer = stage(&options, Stage::Ingest);
    let consumer = stage(&options, Stage::Backbone);
    let mut output = producer.output::<Point>(&Topic::POINTS, 120_000).unwrap();
    let mut input = consumer.input::<Point>(&Topic::POINTS).unwrap();

    let mut loan = output.loan(&FrameHeader::new(0, "a"), 100_000).unwrap();
    let written_in = producer
        .segment_of(loan.elements_mut())
        .expect("written in shared memory");
    loan.elements_mut().fill(Point {
        x_m: 7.0,
        ..Point::default()
    });
    loan.publish().unwrap();

    let message = input.newest().unwrap().unwrap();
    let read_in = consumer
        .segment_of(message.elements())
        .expect("read in shared memory");
    assert_eq!(written_in, read_in, "the same segment");
    assert!(message.elements().iter().all(|point| point.x_m == 7.0));
    assert_eq!(output.bytes_written(), 1_600_000);
    assert_eq!(input.bytes_read(), 1_600_000);
    assert_eq!(input.mappings_verified(), 1);
    let copy = message.elements().to_vec();
    assert!(consumer.segment_of(&copy).is_none(), "a copy is told apart");
}

#[test]
fn newest_wins() {
    let options = options("newest");
    let mut producer = stage(&options, Stage::Ingest);
    let consumer = stage(&options, Stage::Backbone);
    let mut output = producer.output::<Point>(&Topic::POINTS, 100).unwrap();
    let mut input = consumer.input::<Point>(&Topic::POINTS).unwrap();
    send(&mut output, 0, 10);
    let held = input.newest().unwrap().unwrap();
    for sequence in 1..=20 {
        send(&mut output, sequence, 10);
    }
    let newest = input.newest().unwrap().unwrap();
    assert_eq!(newest.header().sequence, 20);
    assert!(
        held.elements().iter().all(|point| point.y_m == 0.0),
        "a held message stays as it was"
    );
    assert!(input.newest().unwrap().is_none());
}

#[test]
fn an_empty_message_arrives_and_an_unsent_one_does_not() {
    let options = options("empty");
    let mut producer = stage(&options, Stage::Ingest);
    let consumer = stage(&options, Stage::Backbone);
    let mut output = producer.output::<Point>(&Topic::POINTS, 100).unwrap();
    let mut input = consumer.input::<Point>(&Topic::POINTS).unwrap();
    drop(output.loan(&FrameHeader::new(0, "a"), 5).unwrap());
    send(&mut output, 1, 0);
    let message = input.newest().unwrap().unwrap();
    assert_eq!(
        (message.header().sequence, message.elements().len()),
        (1, 0)
    );
    assert!(matches!(
        output.loan(&FrameHeader::new(2, "a"), 101).err(),
        Some(RuntimeError::Message { .. })
    ));
}

#[test]
fn blocks_of_64_bytes_keep_their_alignment() {
    let options = options("align");
    let mut producer = stage(&options, Stage::Backbone);
    let consumer = stage(&options, Stage::Head);
    let mut output = producer
        .output::<FeatureBlock>(&Topic::FEATURES, 1000)
        .unwrap();
    let mut input = consumer.input::<FeatureBlock>(&Topic::FEATURES).unwrap();
    let mut loan = output.loan(&FrameHeader::new(0, "a"), 1000).unwrap();
    loan.elements_mut().fill(FeatureBlock([1.5; 16]));
    loan.publish().unwrap();
    let message = input.newest().unwrap().unwrap();
    assert_eq!(message.elements().as_ptr() as usize % 64, 0);
    assert_eq!(message.elements()[999].0, [1.5; 16]);
}

#[test]
fn waiting_wakes_up_says_why_and_ends_on_request() {
    let options = options("wait");
    let shutdown = Shutdown::manual();
    let mut consumer = Shell::stage(options.clone(), Stage::Backbone, shutdown.clone()).unwrap();
    let mut input = consumer.input::<Point>(&Topic::POINTS).unwrap();
    let mut watch = consumer.health_watch().unwrap();
    let topic = Topic {
        deadline_ms: 60,
        ..Topic::POINTS
    };
    let begun = Instant::now();
    let message = consumer.next(&mut input, &topic, |_| {
        if begun.elapsed() > Duration::from_millis(300) {
            shutdown.request();
        }
        Ok(())
    });
    assert!(message.unwrap().is_none());
    assert!(begun.elapsed() < Duration::from_millis(700));
    watch.update().unwrap();
    let health = watch.of(Stage::Backbone).unwrap();
    assert_eq!(health.state, HealthState::WaitingInput as u32);
    assert_eq!(
        health.reason(),
        "waiting for points: no producer is running"
    );
    assert!(!watch.is_ready(Stage::Backbone), "no run has begun");

    let thread_options = options.clone();
    let sender = std::thread::spawn(move || {
        let mut producer = stage(&thread_options, Stage::Ingest);
        let mut output = producer.output::<Point>(&Topic::POINTS, 100).unwrap();
        std::thread::sleep(Duration::from_millis(100));
        send(&mut output, 5, 3);
        std::thread::sleep(Duration::from_millis(200));
    });
    let mut other = stage(&options, Stage::Head);
    let message = other
        .next(&mut input, &Topic::POINTS, |_| Ok(()))
        .unwrap()
        .unwrap();
    assert_eq!(message.header().sequence, 5);
    sender.join().unwrap();
}

#[test]
fn a_stage_runs_once() {
    let options = options("once");
    let first = stage(&options, Stage::Head);
    let second = Shell::stage(options.clone(), Stage::Head, Shutdown::manual());
    assert!(
        matches!(second.err(), Some(RuntimeError::AlreadyRunning { role, .. }) if role == "head")
    );
    drop(first);
    stage(&options, Stage::Head);
}

#[test]
fn nothing_is_left_behind() {
    let options = options("left");
    let mut producer = stage(&options, Stage::Ingest);
    let consumer = stage(&options, Stage::Backbone);
    let mut output = producer.output::<Point>(&Topic::POINTS, 100).unwrap();
    let mut input = consumer.input::<Point>(&Topic::POINTS).unwrap();
    send(&mut output, 0, 10);
    drop(input.newest().unwrap());
    assert!(!leftovers(&options.instance).is_empty());
    drop((output, input));
    drop((producer, consumer));
    assert_eq!(leftovers(&options.instance), Vec::<String>::new());
}

#[test]
fn the_management_segment_is_ours_alone() {
    use std::os::unix::fs::MetadataExt;
    let options = options("mode");
    let _shell = stage(&options, Stage::Ingest);
    for entry in std::fs::read_dir("/dev/shm").unwrap().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with(options.instance.prefix()) {
            let mode = entry.metadata().unwrap().mode() & 0o077;
            assert_eq!(mode, 0, "{name} is open to others");
        }
    }
}
