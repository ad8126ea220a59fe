//! Two processes' worth of ports in one process: each shell maps the segments itself.

use std::time::{Duration, Instant};

use mluc_ipc_types::{FeatureBlock, FrameHeader, HealthState, Point, Stage, Topic};
use mluc_runtime::{Input, Instance, Output, Payload, RuntimeError, Shell, Shutdown};

fn instance(label: &str) -> Instance {
    Instance::new(&format!("{label}-{}", std::process::id())).unwrap()
}

fn stage(instance: &Instance, stage: Stage) -> Shell {
    let mut shell = Shell::stage(instance, stage, Shutdown::default()).unwrap();
    shell.verify_mapping = true;
    shell
}

/// A producer with its output, and a consumer with its input.
struct Pair<T: Payload> {
    output: Output<T>,
    input: Input<T>,
    producer: Shell,
    consumer: Shell,
}

fn pair<T: Payload>(label: &str, topic: &Topic, elements_max: usize) -> Pair<T> {
    let instance = instance(label);
    let mut producer = stage(&instance, Stage::Ingest);
    let consumer = stage(&instance, Stage::Backbone);
    Pair {
        output: producer.output(topic, elements_max).unwrap(),
        input: consumer.input(topic).unwrap(),
        producer,
        consumer,
    }
}

fn send(output: &mut Output<Point>, sequence: u64, points: usize) {
    let point = Point {
        y_m: sequence as f32,
        ..Point::default()
    };
    let header = FrameHeader::new(sequence, "a");
    output.send(&header, &vec![point; points]).unwrap();
}

#[test]
fn a_message_is_written_once_and_read_where_it_lies() {
    let mut pair = pair::<Point>("zero", &Topic::POINTS, 120_000);
    let header = FrameHeader::new(0, "a");
    let mut loan = pair.output.loan(&header, 100_000).unwrap();
    let written_in = pair.producer.segment_of(loan.elements_mut());
    loan.elements_mut().fill(Point {
        x_m: 7.0,
        ..Point::default()
    });
    loan.publish().unwrap();

    let message = pair.input.newest().unwrap().unwrap();
    let read_in = pair.consumer.segment_of(message.elements());
    assert!(read_in.is_some(), "read in shared memory");
    assert_eq!(written_in, read_in, "the same segment");
    assert_eq!(message.elements().len(), 100_000);
    assert!(message.elements().iter().all(|point| point.x_m == 7.0));
    assert_eq!(pair.input.mappings_verified(), 1);
    let copy = message.elements().to_vec();
    let copied_in = pair.consumer.segment_of(&copy);
    assert!(copied_in.is_none(), "a copy is told apart");
}

#[test]
fn newest_wins() {
    let mut pair = pair::<Point>("newest", &Topic::POINTS, 100);
    send(&mut pair.output, 0, 10);
    let held = pair.input.newest().unwrap().unwrap();
    for sequence in 1..=20 {
        send(&mut pair.output, sequence, 10);
    }
    let newest = pair.input.newest().unwrap().unwrap();
    assert_eq!(newest.header().sequence, 20);
    let is_first = |point: &Point| point.y_m == 0.0;
    assert!(held.elements().iter().all(is_first), "it stays as it was");
    assert!(pair.input.newest().unwrap().is_none());
}

#[test]
fn an_empty_message_arrives_and_an_unsent_one_does_not() {
    let mut pair = pair::<Point>("empty", &Topic::POINTS, 100);
    let header = FrameHeader::new(0, "a");
    drop(pair.output.loan(&header, 5).unwrap());
    send(&mut pair.output, 1, 0);
    let message = pair.input.newest().unwrap().unwrap();
    let found = (message.header().sequence, message.elements().len());
    assert_eq!(found, (1, 0));
    let error = pair.output.loan(&header, 101).err();
    assert!(
        matches!(error, Some(RuntimeError::Failed(words)) if words.starts_with("topic points"))
    );
}

#[test]
fn blocks_of_64_bytes_keep_their_alignment() {
    let mut pair = pair::<FeatureBlock>("align", &Topic::FEATURES, 1000);
    let header = FrameHeader::new(0, "a");
    let blocks = [FeatureBlock([1.5; 16]); 1000];
    pair.output.send(&header, &blocks).unwrap();
    let message = pair.input.newest().unwrap().unwrap();
    assert_eq!(message.elements().as_ptr() as usize % 64, 0);
    assert_eq!(message.elements()[999].0, [1.5; 16]);
}

#[test]
fn waiting_wakes_up_says_why_and_ends_on_request() {
    let instance = instance("wait");
    let shutdown = Shutdown::default();
    let mut consumer = Shell::stage(&instance, Stage::Backbone, shutdown.clone()).unwrap();
    let mut input = consumer.input::<Point>(&Topic::POINTS).unwrap();
    let mut watch = consumer.health_watch().unwrap();
    let begun = Instant::now();
    let silence = Topic::SILENCE_MAX + Duration::from_millis(200);
    let message = consumer.next(&mut input, |_| {
        if begun.elapsed() > silence {
            shutdown.request();
        }
        Ok(())
    });
    assert!(message.unwrap().is_none());
    assert!(begun.elapsed() < silence + Duration::from_millis(400));
    watch.update().unwrap();
    let health = watch.of(Stage::Backbone).unwrap();
    assert_eq!(health.state, HealthState::WaitingInput as u32);
    let reason = "waiting for points: no producer is running";
    assert_eq!(health.reason(), reason);
    assert!(!watch.is_ready(Stage::Backbone), "no run has begun");

    let own = instance.clone();
    let sender = std::thread::spawn(move || {
        let mut producer = stage(&own, Stage::Ingest);
        let mut output = producer.output::<Point>(&Topic::POINTS, 100).unwrap();
        std::thread::sleep(Duration::from_millis(100));
        send(&mut output, 5, 3);
        std::thread::sleep(Duration::from_millis(200));
    });
    let mut other = stage(&instance, Stage::Head);
    let message = other.next(&mut input, |_| Ok(())).unwrap().unwrap();
    assert_eq!(message.header().sequence, 5);
    sender.join().unwrap();
}

#[test]
fn the_management_segment_is_ours_alone() {
    use std::os::unix::fs::MetadataExt;
    let instance = instance("mode");
    let _shell = stage(&instance, Stage::Ingest);
    for entry in std::fs::read_dir("/dev/shm").unwrap().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with(instance.prefix()) {
            let mode = entry.metadata().unwrap().mode() & 0o077;
            assert_eq!(mode, 0, "{name} is open to others");
        }
    }
}
