//! The ports of two processes, in one process: each shell maps the segments itself.

use mluc_ipc_types::{FeatureBlock, FrameHeader, Point, Stage, Topic};
use mluc_runtime::{Input, Instance, Output, Payload, RuntimeError, Shell, Shutdown};

fn instance(label: &str) -> Instance {
    Instance::new(&format!("{label}-{}", std::process::id())).unwrap()
}

fn stage(instance: &Instance, stage: Stage) -> Shell {
    let mut shell = Shell::stage(instance, stage, Shutdown::default()).unwrap();
    shell.verify_mapping = true;
    shell
}

/// The shells of a producer and a consumer, the producer's output and the consumer's input.
fn pair<T: Payload>(label: &str, topic: &Topic, most: usize) -> ([Shell; 2], Output<T>, Input<T>) {
    let instance = instance(label);
    let mut shells = [Stage::Ingest, Stage::Backbone].map(|name| stage(&instance, name));
    let output = shells[0].output(topic, most).unwrap();
    let input = shells[1].input(topic).unwrap();
    (shells, output, input)
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
    let (shells, mut output, mut input) = pair::<Point>("zero", &Topic::POINTS, 120_000);
    let header = FrameHeader::new(0, "a");
    let mut loan = output.loan(&header, 100_000).unwrap();
    let written_in = shells[0].segment_of(loan.elements_mut());
    loan.elements_mut().fill(Point {
        x_m: 7.0,
        ..Point::default()
    });
    loan.publish().unwrap();

    let message = input.newest().unwrap().unwrap();
    let read_in = shells[1].segment_of(message.elements());
    assert!(read_in.is_some(), "read in shared memory");
    assert_eq!(written_in, read_in, "the same segment");
    assert_eq!(message.elements().len(), 100_000);
    assert!(message.elements().iter().all(|point| point.x_m == 7.0));
    assert_eq!(input.mappings_verified(), 1);
    let copy = message.elements().to_vec();
    let copied_in = shells[1].segment_of(&copy);
    assert!(copied_in.is_none(), "a copy is told apart");
}

#[test]
fn an_empty_message_arrives_and_an_unsent_one_does_not() {
    let (_shells, mut output, mut input) = pair::<Point>("empty", &Topic::POINTS, 100);
    let header = FrameHeader::new(0, "a");
    drop(output.loan(&header, 5).unwrap());
    send(&mut output, 1, 0);
    let message = input.newest().unwrap().unwrap();
    let found = (message.header().sequence, message.elements().len());
    assert_eq!(found, (1, 0));
    let error = output.loan(&header, 101).err();
    assert!(matches!(error, Some(RuntimeError::Failed(why)) if why.starts_with("topic points")));
}

#[test]
fn blocks_of_64_bytes_keep_their_alignment() {
    let (_shells, mut output, mut input) = pair::<FeatureBlock>("align", &Topic::FEATURES, 1000);
    let header = FrameHeader::new(0, "a");
    let blocks = [FeatureBlock([1.5; 16]); 1000];
    output.send(&header, &blocks).unwrap();
    let message = input.newest().unwrap().unwrap();
    assert_eq!(message.elements().as_ptr() as usize % 64, 0);
    assert_eq!(message.elements()[999].0, [1.5; 16]);
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
