//! The C functions, called as C calls them; the same process plays the stages before and after the refiner.

use bytemuck::Zeroable;
use mluc_capi::{
    Code, MlucFrame, MlucRefiner, mluc_last_error, mluc_refiner_close, mluc_refiner_open,
    mluc_refiner_publish, mluc_refiner_wait, mluc_wire_version,
};
use mluc_ipc_types::{
    CandidateCounts, Detection, Disposition, FOOTPRINT_MAX, Flags, FrameHeader, HealthState,
    Object, ObjectKind, Point, RunDescription, Stage, Topic, WIRE_VERSION,
};
use mluc_runtime::{ClaimNote, Input, Instance, Output, Shell, Shutdown, monotonic_ns};
use std::{ffi::CStr, ptr::null_mut};

/// A run of a model with two classes.
fn description(run_id: u64) -> RunDescription {
    RunDescription {
        wire_version: WIRE_VERSION,
        classes_count: 2,
        run_id,
        model_fingerprint: 42,
        ..RunDescription::zeroed()
    }
}

struct Others {
    points: Output<Point>,
    detections: Output<Detection>,
    objects: Input<Object>,
    object_points: Input<u32>,
    shell: Shell,
}

impl Others {
    fn new(instance: &Instance) -> Others {
        let mut shell = Shell::observer(instance, None, Shutdown::default()).unwrap();
        assert!(shell.begin_run(&description(1)).unwrap());
        Others {
            points: shell.output(&Topic::POINTS, 100).unwrap(),
            detections: shell.output(&Topic::DETECTIONS, 10).unwrap(),
            objects: shell.input(&Topic::OBJECTS).unwrap(),
            object_points: shell.side_input(&Topic::OBJECT_POINTS).unwrap(),
            shell,
        }
    }

    fn send(&mut self, sequence: u64, change: impl FnOnce(&mut FrameHeader)) {
        // A refiner that joined later gets the description of the run.
        self.shell.tick().unwrap();
        let mut header = FrameHeader::new(sequence, "a");
        (header.run_id, header.model_fingerprint) = (1, 42);
        change(&mut header);
        let point = Point { x_m: sequence as f32, ..Point::default() };
        let detection = Detection { size_m: [1.0; 3], ..Detection::default() };
        self.points.send(&header, &[point; 100]).unwrap();
        self.detections.send(&header, &[detection]).unwrap();
    }
}

fn words() -> String {
    // SAFETY: the library's own text, ended by NUL.
    let text = unsafe { CStr::from_ptr(mluc_last_error()) };
    text.to_string_lossy().into_owned()
}

fn wait(refiner: *mut MlucRefiner, timeout_ms: u32) -> (i32, MlucFrame) {
    let mut frame = MlucFrame { points_count: 7, detections_count: 7, ..MlucFrame::zeroed() };
    // SAFETY: an open handle, and a place for the frame.
    let code = unsafe { mluc_refiner_wait(refiner, timeout_ms, &mut frame) };
    (code, frame)
}

fn publish(refiner: *mut MlucRefiner, objects: &[Object], indices: &[u32]) -> i32 {
    let (o, i, flags) = (objects.as_ptr(), indices.as_ptr(), Flags::DEGRADED.0);
    // SAFETY: an open handle, and slices.
    unsafe { mluc_refiner_publish(refiner, o, objects.len(), i, indices.len(), flags) }
}

fn sound_object() -> Object {
    let mut footprint_m = [[0.0; 2]; FOOTPRINT_MAX];
    footprint_m[..3].copy_from_slice(&[[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]);
    Object {
        footprint_count: 3,
        footprint_m,
        suppressed_by: Object::NONE,
        track_id: Object::NONE,
        size_m: [1.0; 3],
        points_count: 2,
        ..Object::zeroed()
    }
}

/// There is one test only: the library reads the environment, which the whole process shares.
#[test]
fn a_refiner_lives_its_life() {
    assert_eq!(mluc_wire_version(), WIRE_VERSION);
    let name = format!("capi-{}", std::process::id());
    let instance = Instance::new(&name).unwrap();
    // SAFETY: no other thread of this test reads the environment.
    unsafe { std::env::set_var(Instance::VARIABLE, &name) };
    let mut others = Others::new(&instance);
    let mut refiner: *mut MlucRefiner = null_mut();
    // SAFETY: a place for the handle.
    assert_eq!(unsafe { mluc_refiner_open(&mut refiner) }, Code::Ok as i32);
    calls_out_of_turn_are_errors(refiner);
    a_frame_comes_where_it_lies(refiner, &mut others);
    assert_eq!(frame_in_work(&instance), Some(4), "should it die now");
    what_breaks_the_contract_is_not_published(refiner, &mut others);
    a_frame_is_published_once(refiner, &mut others);
    assert_eq!(frame_in_work(&instance), None);
    candidates_are_counted(refiner, &mut others);
    // SAFETY: opened above, used no more.
    unsafe { mluc_refiner_close(refiner) };
    // SAFETY: null is allowed.
    unsafe { mluc_refiner_close(null_mut()) };
}

/// What a supervisor reads after the process has died: a scan that kills the process twice is set aside.
fn frame_in_work(instance: &Instance) -> Option<u64> {
    let note = ClaimNote::read(instance, "refiner").expect("it is claimed");
    assert_eq!(note.pid, std::process::id());
    note.sequence
}

fn calls_out_of_turn_are_errors(refiner: *mut MlucRefiner) {
    // A second refiner is refused; the error names the first.
    let mut second: *mut MlucRefiner = null_mut();
    // SAFETY: a place for the handle.
    assert_eq!(unsafe { mluc_refiner_open(&mut second) }, Code::Open as i32);
    assert!(second.is_null());
    assert!(words().contains("already run by process"), "{}", words());

    assert_eq!(wait(null_mut(), 1).0, Code::Usage as i32);
    assert_eq!(publish(refiner, &[], &[]), Code::Usage as i32);
    assert!(words().contains("no frame"), "{}", words());
    // SAFETY: null is the tested case.
    assert_eq!(unsafe { mluc_refiner_open(null_mut()) }, Code::Usage as i32);

    let (code, frame) = wait(refiner, 5);
    assert_eq!(code, Code::Timeout as i32);
    assert_eq!((frame.points_count, frame.detections_count), (0, 0));
}

/// The newest frame comes, with its own points.
fn a_frame_comes_where_it_lies(refiner: *mut MlucRefiner, others: &mut Others) {
    others.send(3, |_| ());
    others.send(4, |_| ());
    let (code, frame) = wait(refiner, 2000);
    assert_eq!(code, Code::Ok as i32);
    // SAFETY: valid until the next call.
    let (header, run) = unsafe { (*frame.header, *frame.run) };
    // SAFETY: as above.
    let points = unsafe { std::slice::from_raw_parts(frame.points, frame.points_count) };
    let found = (header.sequence, points.len(), points[0].x_m);
    assert_eq!(found, (4, 100, 4.0));
    assert_eq!(frame.detections_count, 1);
    assert_eq!(run, description(1));
}

fn what_breaks_the_contract_is_not_published(refiner: *mut MlucRefiner, others: &mut Others) {
    let changes: [fn(&mut Object); 4] = [
        |object| object.footprint_m.swap(0, 1),
        |object| object.class_id = 2,
        |object| object.yaw_rad = f32::NAN,
        |object| object.points_count = 3,
    ];
    for change in changes {
        let mut object = sound_object();
        change(&mut object);
        assert_eq!(publish(refiner, &[object], &[5, 99]), Code::Contract as i32);
    }
    assert_eq!(publish(refiner, &[], &[]), Code::Contract as i32);
    assert!(words().contains("one for each detection"), "{}", words());
    let found = publish(refiner, &[sound_object()], &[5, 100]);
    assert_eq!(found, Code::Contract as i32);
    assert!(words().contains("index 100"), "{}", words());
    assert!(others.objects.oldest().unwrap().is_none());
}

fn a_frame_is_published_once(refiner: *mut MlucRefiner, others: &mut Others) {
    for code in [Code::Ok, Code::Usage] {
        let found = publish(refiner, &[sound_object()], &[5, 99]);
        assert_eq!(found, code as i32);
    }
    let answer = others.objects.oldest().unwrap().unwrap();
    assert_eq!(answer.header().sequence, 4);
    assert!(Flags(answer.header().flags).contains(Flags::DEGRADED));
    let stamps = answer.header().stages[Stage::Refiner as usize];
    assert!(stamps.received_ns <= stamps.started_ns && stamps.started_ns <= stamps.published_ns);
    assert!(stamps.published_ns <= monotonic_ns());
    assert_eq!(answer.elements()[0], sound_object());
    let indices = others.object_points.oldest().unwrap().unwrap();
    assert_eq!(indices.elements(), [5, 99]);
}

fn candidates_are_counted(refiner: *mut MlucRefiner, others: &mut Others) {
    let mut watch = others.shell.health_watch().unwrap();
    others.send(5, |header| header.model_fingerprint = 43);
    assert_eq!(wait(refiner, 300).0, Code::Timeout as i32);
    others.send(6, |_| ());
    assert_eq!(wait(refiner, 2000).0, Code::Ok as i32);
    let unknown =
        Object { kind: ObjectKind::Unknown as u32, flags: Object::SPLIT, ..sound_object() };
    let found = publish(refiner, &[unknown], &[5, 99]);
    assert_eq!(found, Code::Ok as i32);
    watch.update().unwrap();
    let health = *watch.of(Stage::Refiner).unwrap();
    assert_eq!(health.state, HealthState::Running as u32);
    assert_eq!((health.messages_refused, health.frames_out), (1, 2));
    let mut expected = CandidateCounts::default();
    expected.by_disposition[Disposition::Published as usize] = 1;
    expected.split = 1;
    assert_eq!(health.candidates, expected);
}
