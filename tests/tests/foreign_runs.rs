//! A refiner that is somebody else's: it outlives runs and loses no frame, and no message of it, however wrong, silences the
//! pipeline.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::JoinHandle;

use mluc_ipc_types::{
    Detection, FrameHeader, HealthState, OBJECT_POINTS_MAX, OBJECTS_MAX, Object, Stage, Topic,
};
use mluc_runtime::{Frames, Instance, Output, RuntimeError, Shell, Shutdown, monotonic_ns};
use mluc_tests::{Finished, Pipeline, clean_folder, leftovers, unique_instance, untrained_model};

/// A refiner in this process that publishes no object: each frame's answer goes through `answer`, which sends what it likes.
struct Foreign {
    shutdown: Shutdown,
    refused: Arc<AtomicU64>,
    thread: Option<JoinHandle<Result<(), RuntimeError>>>,
}

type Answer = fn(&mut Output<Object>, &FrameHeader) -> Result<(), RuntimeError>;

impl Foreign {
    fn start(instance: &str, answer: Answer) -> Foreign {
        let instance = Instance::new(instance).unwrap();
        let (shutdown, refused) = (Shutdown::manual(), Arc::new(AtomicU64::new(0)));
        let (own_shutdown, own_refused) = (shutdown.clone(), refused.clone());
        let thread =
            std::thread::spawn(move || refine(&instance, own_shutdown, &own_refused, answer));
        Foreign {
            shutdown,
            refused,
            thread: Some(thread),
        }
    }

    /// Ends it; gives the messages that it refused.
    fn end(mut self) -> u64 {
        self.shutdown.request();
        let ended = self.thread.take().map(JoinHandle::join);
        ended.unwrap().expect("no panic").expect("no error");
        self.refused.load(Ordering::SeqCst)
    }
}

impl Drop for Foreign {
    fn drop(&mut self) {
        self.shutdown.request();
    }
}

fn refine(
    instance: &Instance,
    shutdown: Shutdown,
    refused: &AtomicU64,
    answer: Answer,
) -> Result<(), RuntimeError> {
    let mut shell = Shell::stage(instance, Stage::Refiner, shutdown)?;
    let mut objects = shell.output::<Object>(&Topic::OBJECTS, OBJECTS_MAX)?;
    let mut points = shell.output::<u32>(&Topic::OBJECT_POINTS, OBJECT_POINTS_MAX)?;
    let mut frames = Frames::<Detection>::with_points(&shell, &Topic::DETECTIONS)?;
    shell.state(HealthState::WaitingInput, "waiting for detections")?;
    while let Some(message) = frames.next(&mut shell)? {
        let mut header = *message.header();
        let now_ns = monotonic_ns();
        let stamps = header.stamps_mut(Stage::Refiner);
        (stamps.received_ns, stamps.started_ns, stamps.published_ns) = (now_ns, now_ns, now_ns);
        points.loan(&header, 0)?.publish()?;
        answer(&mut objects, &header)?;
        frames.release();
        shell.health.frames_in += 1;
        shell.health.frames_out += 1;
        refused.store(shell.health.messages_refused, Ordering::SeqCst);
        shell.state(HealthState::Running, "")?;
        shell.tick()?;
    }
    shell.state(HealthState::Stopping, "")
}

fn publish(objects: &mut Output<Object>, header: &FrameHeader) -> Result<(), RuntimeError> {
    objects.loan(header, 0)?.publish()
}

fn up(instance: &str, scans: usize, pace: &str) -> Finished {
    let folder = tempfile::tempdir().unwrap();
    let (model, input) = (
        untrained_model(folder.path()),
        clean_folder(folder.path(), scans),
    );
    let more = ["--pace", pace, "--without", "refiner"];
    Pipeline::up(instance, &model, &input, &more).finish()
}

fn sequences(run: &Finished) -> Vec<u64> {
    let lines = run.lines.iter();
    lines.filter_map(|line| line["sequence"].as_u64()).collect()
}

#[test]
fn a_refiner_that_outlives_three_runs_loses_no_frame() {
    let instance = unique_instance("outlive");
    let refiner = Foreign::start(&instance, publish);
    let mut lines = 0;
    for _ in 0..3 {
        let run = up(&instance, 22, "complete");
        assert_eq!(run.code, Some(0), "{}", run.log);
        assert_eq!(sequences(&run), (0..22).collect::<Vec<_>>(), "{}", run.log);
        lines += run.lines.len();
    }
    assert_eq!(lines, 66);
    assert_eq!(refiner.end(), 0, "nothing was to be refused");
    assert_eq!(leftovers(&instance), Vec::<String>::new());
}

/// Before each answer: sequences that never were, that go back, and messages of another run and model.
fn hostile(objects: &mut Output<Object>, header: &FrameHeader) -> Result<(), RuntimeError> {
    let changes: [fn(&mut FrameHeader); 7] = [
        |h| h.sequence = u64::MAX - 1,
        |h| h.sequence = u64::MAX,
        |h| h.sequence += 1,
        |h| h.sequence = 0,
        |h| h.run_id ^= 1,
        |h| h.model_fingerprint ^= 1,
        |h| h.wire_version += 1,
    ];
    for change in changes {
        let mut wrong = *header;
        change(&mut wrong);
        publish(objects, &wrong)?;
        // The queue of a topic holds two: each is to be read.
        std::thread::sleep(std::time::Duration::from_millis(30));
    }
    publish(objects, header)
}

#[test]
fn hostile_sequences_silence_nobody() {
    let instance = unique_instance("hostile");
    let refiner = Foreign::start(&instance, hostile);
    let run = up(&instance, 6, "complete");
    assert_eq!(sequences(&run), (0..6).collect::<Vec<_>>(), "{}", run.log);
    assert_eq!(run.code, Some(0), "{}", run.log);
    assert!(run.log.contains("6 in, 6 out, 0 lost"), "{}", run.log);
    assert!(
        run.log.contains("message refused: objects: sequence"),
        "{}",
        run.log
    );
    refiner.end();
    assert_eq!(leftovers(&instance), Vec::<String>::new());
}
