//! Stages die and come back; everything ends when asked, and leaves nothing.

use std::time::{Duration, Instant};

use mluc_tests::{
    Pipeline, clean_folder, leftovers, send_signal, unique_instance, untrained_model,
};
use rustix::process::{Pid, Signal, test_kill_process};

const SECOND: Duration = Duration::from_secs(1);

fn is_alive(pid: u32) -> bool {
    Pid::from_raw(pid as i32).is_some_and(|pid| test_kill_process(pid).is_ok())
}

#[test]
fn each_killed_stage_comes_back_and_no_frame_is_lost() {
    let folder = tempfile::tempdir().unwrap();
    let (model, input) = (
        untrained_model(folder.path()),
        clean_folder(folder.path(), 60),
    );
    let instance = unique_instance("kill");
    let mut run = Pipeline::up(&instance, &model, &input, &["--pace", "complete"]);
    for (number, stage) in ["backbone", "head", "refiner", "ingest"]
        .into_iter()
        .enumerate()
    {
        let before = run.line_count();
        run.wait_until("frames flow", |p| p.line_count() >= before + 3);
        let stages = run.stages();
        let (_, pid) = stages
            .iter()
            .find(|(name, _)| name == stage)
            .expect("all stages run");
        send_signal(*pid, Signal::KILL);
        run.wait_until("it has another process", |p| {
            p.stages()
                .iter()
                .any(|(name, new)| name == stage && new != pid)
        });
        assert!(run.log().matches("restart in").count() > number);
    }
    let finished = run.finish();
    assert_eq!(finished.code, Some(3), "{}", finished.log);
    let expected: Vec<String> = (0..60).map(|number| format!("{number:06}")).collect();
    assert_eq!(finished.frames(), expected, "{}", finished.log);
    assert!(
        finished.log.contains("0 lost; stages restarted: 4"),
        "{}",
        finished.log
    );
    assert_eq!(leftovers(&instance), Vec::<String>::new());
}

/// From the signal to the end of everything.
fn time_to_end(signal: Signal, pace: &str) -> Duration {
    let folder = tempfile::tempdir().unwrap();
    let (model, input) = (
        untrained_model(folder.path()),
        clean_folder(folder.path(), 3),
    );
    let instance = unique_instance("term");
    let mut run = Pipeline::up(&instance, &model, &input, &["--pace", pace, "--loop"]);
    run.wait_until("frames flow", |p| p.line_count() > 3);
    let stages = run.stages();
    assert_eq!(stages.len(), 4);
    let begun = Instant::now();
    run.signal(signal);
    let finished = run.finish();
    let took = begun.elapsed();
    assert_eq!(finished.code, Some(0), "{}", finished.log);
    assert_eq!(leftovers(&instance), Vec::<String>::new());
    assert!(stages.iter().all(|(_, pid)| !is_alive(*pid)));
    took
}

#[test]
fn a_signal_ends_all_within_a_second_and_leaves_nothing() {
    for (signal, pace) in [(Signal::TERM, "complete"), (Signal::INT, "sensor")] {
        // Tests run beside each other on few cores: the best of three tells what the program needs by itself.
        let best = (0..3)
            .map(|_| time_to_end(signal, pace))
            .find(|took| *took < SECOND);
        assert!(best.is_some(), "three ends took longer than a second");
    }
}

#[test]
fn stages_end_when_their_supervisor_is_killed() {
    let folder = tempfile::tempdir().unwrap();
    let (model, input) = (
        untrained_model(folder.path()),
        clean_folder(folder.path(), 3),
    );
    let instance = unique_instance("orphan");
    let mut run = Pipeline::up(&instance, &model, &input, &["--pace", "complete", "--loop"]);
    run.wait_until("frames flow", |p| p.line_count() > 1);
    let stages = run.stages();
    run.signal(Signal::KILL);
    let begun = Instant::now();
    while stages.iter().any(|(_, pid)| is_alive(*pid)) || !leftovers(&instance).is_empty() {
        assert!(
            begun.elapsed() < 10 * SECOND,
            "{stages:?} {:?}",
            leftovers(&instance)
        );
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn a_crash_of_everything_is_wiped_by_the_next_start() {
    let folder = tempfile::tempdir().unwrap();
    let (model, input) = (
        untrained_model(folder.path()),
        clean_folder(folder.path(), 2),
    );
    let instance = unique_instance("crash");
    let mut run = Pipeline::up(&instance, &model, &input, &["--pace", "complete", "--loop"]);
    run.wait_until("frames flow", |p| p.line_count() > 1);
    // The supervisor must not see its stages die.
    run.signal(Signal::STOP);
    let stages = run.stages();
    for (_, pid) in &stages {
        send_signal(*pid, Signal::KILL);
    }
    run.signal(Signal::KILL);
    drop(run);
    // A killed process holds its lock until the kernel has taken its memory back.
    let begun = Instant::now();
    while stages.iter().any(|(_, pid)| is_alive(*pid)) {
        assert!(begun.elapsed() < 10 * SECOND, "{stages:?}");
        std::thread::sleep(Duration::from_millis(10));
    }
    assert!(
        !leftovers(&instance).is_empty(),
        "a crash leaves files: else this test shows nothing"
    );
    let again = Pipeline::up(&instance, &model, &input, &["--pace", "complete"]).finish();
    assert_eq!(
        (again.code, again.frames().len()),
        (Some(0), 2),
        "{}",
        again.log
    );
    assert_eq!(leftovers(&instance), Vec::<String>::new());
}
