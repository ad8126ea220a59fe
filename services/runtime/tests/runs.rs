//! The ports of two processes, in one process: each shell maps the segments itself. Frames of another run or model, or out of sequence, are never used.
//! Heartbeats that make no sense are ignored.

use bytemuck::Zeroable;
use mluc_ipc_types::{
    Detection, FeatureBlock, FrameHeader, Health, HealthState, Point, RunDescription, Stage, Topic,
    WIRE_VERSION,
};
use mluc_runtime::{
    Frames, Input, Instance, Next, Output, Payload, RuntimeError, Scans, Shell, Shutdown,
    random_run_id,
};
use std::time::Duration;

const MODEL: u64 = 42;
/// The model that the run changes to.
const OTHER_MODEL: u64 = 40;

fn instance(label: &str) -> Instance {
    Instance::new(&format!("{label}-{}", std::process::id())).unwrap()
}

fn observer(instance: &Instance) -> Shell {
    Shell::observer(instance, None, Shutdown::default()).unwrap()
}

fn stage(instance: &Instance, stage: Stage) -> Shell {
    Shell::stage(instance, stage, Shutdown::default()).unwrap()
}

fn description() -> RunDescription {
    RunDescription {
        wire_version: WIRE_VERSION,
        classes_count: 3,
        run_id: random_run_id(),
        model_fingerprint: MODEL,
        other_model_fingerprint: OTHER_MODEL,
        ..RunDescription::zeroed()
    }
}

/// The stages before a consumer; a test may make them hostile.
struct Others {
    points: Output<Point>,
    detections: Output<Detection>,
    features: Output<FeatureBlock>,
    shell: Shell,
    run: RunDescription,
}

impl Others {
    fn new(instance: &Instance) -> Others {
        let mut shell = observer(instance);
        let run = description();
        assert!(shell.begin_run(&run).unwrap());
        Others {
            points: shell.output(&Topic::POINTS, 10).unwrap(),
            detections: shell.output(&Topic::DETECTIONS, 10).unwrap(),
            features: shell.output(&Topic::FEATURES, 10).unwrap(),
            shell,
            run,
        }
    }

    fn begin_run(&mut self) {
        self.run = description();
        assert!(self.shell.begin_run(&self.run).unwrap());
    }

    fn header(&self, sequence: u64) -> FrameHeader {
        let mut header = FrameHeader::new(sequence, "a");
        (header.run_id, header.model_fingerprint) = (self.run.run_id, MODEL);
        header
    }

    fn scan(&mut self, sequence: u64) {
        let header = self.header(sequence);
        self.points.loan(&header, 5).unwrap().publish().unwrap();
    }

    fn send(&mut self, change: impl Fn(&mut FrameHeader), sequence: u64) {
        let mut header = self.header(sequence);
        change(&mut header);
        self.detections.loan(&header, 0).unwrap().publish().unwrap();
        self.features.loan(&header, 0).unwrap().publish().unwrap();
    }
}

fn frames<T: Payload>(shell: &Shell, topic: &Topic, holds_scans: bool) -> Frames<T> {
    let scans = Scans::open(shell, holds_scans).unwrap();
    Frames::new(shell, topic, Some(scans)).unwrap()
}

/// The sequence of the frame that is taken; `None`: no frame is taken.
fn taken<T: Payload>(
    frames: &mut Frames<T>,
    shell: &mut Shell,
    ahead: impl FnMut(&FrameHeader, &[Point]),
) -> Option<u64> {
    let timeout = Duration::from_millis(1);
    match frames.next_within(shell, ahead, timeout).unwrap() {
        Next::Message(message) => Some(message.header().sequence),
        _ => None,
    }
}

#[test]
fn a_scan_is_shown_ahead_of_its_frame_once_and_not_before_one_that_is_on_its_way() {
    let instance = instance("ahead");
    let mut others = Others::new(&instance);
    let mut refiner = stage(&instance, Stage::Refiner);
    let mut frames = frames::<Detection>(&refiner, &Topic::DETECTIONS, true);
    let mut look = |frame: Option<u64>| {
        let mut shown = vec![];
        let ahead = |header: &FrameHeader, points: &[Point]| {
            assert_eq!(points.len(), 5);
            shown.push(header.sequence);
        };
        assert_eq!(taken(&mut frames, &mut refiner, ahead), frame);
        shown
    };
    let none: [u64; 0] = [];
    for _ in 0..2 {
        others.shell.tick().unwrap();
        others.scan(0);
        assert_eq!(look(None), [0]);
        assert_eq!(look(None), none, "once");
        others.scan(1);
        others.scan(2);
        assert_eq!(look(None), none, "frame 0 is on its way");
        others.send(|_| (), 0);
        assert_eq!(look(Some(0)), none);
        assert_eq!(look(None), [2], "the newest");
        others.begin_run();
    }
}

#[test]
fn hostile_sequences_runs_and_models_are_refused_and_the_next_frame_comes() {
    let instance = instance("hostile");
    let mut others = Others::new(&instance);
    let mut head = stage(&instance, Stage::Head);
    let mut refiner = stage(&instance, Stage::Refiner);
    let mut features = frames::<FeatureBlock>(&head, &Topic::FEATURES, false);
    let mut detections = frames::<Detection>(&refiner, &Topic::DETECTIONS, false);
    let mut both = |others: &mut Others| {
        others.shell.tick().unwrap();
        let of_head = taken(&mut features, &mut head, |_, _| ());
        let of_refiner = taken(&mut detections, &mut refiner, |_, _| ());
        assert_eq!(of_head, of_refiner);
        let counters = [&head.health, &refiner.health];
        let counts = counters.map(|c| (c.messages_refused, c.frames_dropped));
        (of_head, counts)
    };
    // Both consumers get the description of the run.
    assert_eq!(both(&mut others).0, None);
    others.scan(3);
    others.send(|_| (), 3);
    assert_eq!(both(&mut others).0, Some(3));
    type Spoil = fn(&mut FrameHeader);
    let spoils: [(&str, Spoil); 8] = [
        ("2^64-1", |h| h.sequence = u64::MAX),
        ("2^64-2", |h| h.sequence = u64::MAX - 1),
        ("not sent yet", |h| h.sequence = 5),
        ("back", |h| h.sequence = 2),
        ("another run", |h| h.run_id ^= 1),
        ("no run", |h| h.run_id = 0),
        ("another model", |h| h.model_fingerprint ^= 1),
        ("no model", |h| h.model_fingerprint = 0),
    ];
    for (number, (what, spoil)) in spoils.into_iter().enumerate() {
        others.send(spoil, 4);
        let (frame, counts) = both(&mut others);
        assert_eq!(frame, None, "{what}");
        assert_eq!(counts, [(number as u64 + 1, 0); 2], "{what}");
    }
    // A frame that is sent again with the run's other model is taken. A gap is counted.
    others.send(|header| header.model_fingerprint = OTHER_MODEL, 3);
    assert_eq!(both(&mut others).0, Some(3));
    others.scan(6);
    others.send(|_| (), 6);
    assert_eq!(both(&mut others), (Some(6), [(8, 2); 2]));
    // The next run begins at 0; the last message of the old one is not used.
    let old = others.run;
    others.begin_run();
    others.scan(0);
    others.send(|header| header.run_id = old.run_id, 6);
    assert_eq!(both(&mut others).0, None);
    others.send(|_| (), 0);
    assert_eq!(both(&mut others), (Some(0), [(9, 2); 2]));
}

#[test]
fn a_late_reader_gets_the_description_and_a_second_writer_is_none() {
    let instance = instance("latched");
    let mut others = Others::new(&instance);
    let mut late = observer(&instance);
    assert!(late.run().is_none());
    others.shell.tick().unwrap();
    assert!(late.await_run(Duration::from_secs(1)).unwrap());
    assert_eq!(late.run().map(|run| run.run_id), Some(others.run.run_id));
    assert!(!late.begin_run(&description()).unwrap());
    drop(others);
    assert!(late.begin_run(&description()).unwrap(), "the writer left");
}

#[test]
fn a_heartbeat_that_makes_no_sense_is_left_out() {
    let instance = instance("garbage");
    let mut others = Others::new(&instance);
    let topic = Topic { name: "health/refiner", ..Topic::HEALTH };
    let mut output = others.shell.output::<Health>(&topic, 1).unwrap();
    let mut watch = others.shell.health_watch().unwrap();
    let sound = Health {
        wire_version: WIRE_VERSION,
        stage: Stage::Refiner as u32,
        state: HealthState::Running as u32,
        pid: 77,
        run_id: others.run.run_id,
        frames_in: 5,
        frames_out: 5,
        ..Health::zeroed()
    };
    let mut send = |change: &dyn Fn(&mut Health)| {
        let mut health = sound;
        change(&mut health);
        let header = FrameHeader::new(0, "refiner");
        output.send(&header, &[health]).unwrap();
    };
    send(&|h| h.run_id = 0);
    watch.update().unwrap();
    assert!(watch.of(Stage::Refiner).is_some() && !watch.is_ready(Stage::Refiner));
    others.shell.tick().unwrap();
    watch.update().unwrap();
    // The tests of `Health::checked` cover further invalid heartbeats.
    let changes: [&dyn Fn(&mut Health); 5] = [
        &|h| *h = bytemuck::cast([0xa5u8; size_of::<Health>()]),
        &|h| *h = Health::zeroed(),
        &|h| h.stage = Stage::Ingest as u32,
        &|h| h.run_id ^= 1,
        &|h| h.wire_version += 1,
    ];
    for (number, change) in changes.into_iter().enumerate() {
        send(change);
        watch.update().unwrap();
        assert_eq!(watch.of(Stage::Refiner), None, "change {number}");
        assert_eq!(watch.of(Stage::Ingest), None, "change {number}");
    }
    send(&|h| h.run_id = 0);
    watch.update().unwrap();
    assert!(watch.of(Stage::Refiner).is_some() && !watch.is_ready(Stage::Refiner));
    send(&|_| ());
    watch.update().unwrap();
    assert!(watch.is_ready(Stage::Refiner));
}

/// The shells of a producer and a consumer, the producer's output and the consumer's input.
fn pair<T: Payload>(label: &str, topic: &Topic, most: usize) -> ([Shell; 2], Output<T>, Input<T>) {
    let instance = instance(label);
    let mut shells = [Stage::Ingest, Stage::Backbone].map(|name| stage(&instance, name));
    shells.iter_mut().for_each(|shell| shell.verify_mapping = true);
    let output = shells[0].output(topic, most).unwrap();
    let input = shells[1].input(topic).unwrap();
    (shells, output, input)
}

fn send_points(output: &mut Output<Point>, sequence: u64, points: usize) {
    let point = Point { y_m: sequence as f32, ..Point::default() };
    let header = FrameHeader::new(sequence, "a");
    output.send(&header, &vec![point; points]).unwrap();
}

#[test]
fn a_message_is_written_once_and_read_where_it_lies() {
    let (shells, mut output, mut input) = pair::<Point>("zero", &Topic::POINTS, 120_000);
    let header = FrameHeader::new(0, "a");
    let mut loan = output.loan(&header, 100_000).unwrap();
    let written_in = shells[0].segment_of(loan.elements_mut());
    loan.elements_mut().fill(Point { x_m: 7.0, ..Point::default() });
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
    send_points(&mut output, 1, 0);
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
    let mut count = 0;
    for entry in std::fs::read_dir("/dev/shm").unwrap().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with(instance.prefix()) {
            let mode = entry.metadata().unwrap().mode() & 0o077;
            assert_eq!(mode, 0, "{name} is open to others");
            count += 1;
        }
    }
    assert!(count > 0);
}
