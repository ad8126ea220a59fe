//! Stages die and come back; everything ends when asked, and leaves nothing.

use std::time::{Duration, Instant};

use mluc_tests::{Setting, leftovers, send_signal};
use rustix::process::{Pid, Signal, test_kill_process};

const SECOND: Duration = Duration::from_secs(1);

fn is_alive(pid: u32) -> bool {
    Pid::from_raw(pid as i32).is_some_and(|pid| test_kill_process(pid).is_ok())
}

#[test]
fn each_killed_stage_comes_back_and_no_frame_is_lost() {
    let setting = Setting::new("kill", 60);
    let mut run = setting.up(&[]);
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
    let finished = setting.finish(run);
    assert_eq!(finished.code, Some(3), "{}", finished.log);
    let expected: Vec<String> = (0..60).map(|number| format!("{number:06}")).collect();
    assert_eq!(finished.frames(), expected, "{}", finished.log);
    assert!(
        finished.log.contains("0 lost; stages restarted: 4"),
        "{}",
        finished.log
    );
}

/// From the signal to the end of everything.
fn time_to_end(signal: Signal, pace: &str) -> Duration {
    let setting = Setting::new("term", 3);
    let mut run = setting.up(&["--pace", pace, "--loop"]);
    run.wait_until("frames flow", |p| p.line_count() > 3);
    let stages = run.stages();
    assert_eq!(stages.len(), 4);
    let begun = Instant::now();
    run.signal(signal);
    let finished = run.finish();
    let took = begun.elapsed();
    assert_eq!(finished.code, Some(0), "{}", finished.log);
    assert_eq!(leftovers(&setting.instance), [""; 0]);
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
    let setting = Setting::new("orphan", 3);
    let instance = &setting.instance;
    let mut run = setting.up(&["--loop"]);
    run.wait_until("frames flow", |p| p.line_count() > 1);
    let stages = run.stages();
    run.signal(Signal::KILL);
    let begun = Instant::now();
    while stages.iter().any(|(_, pid)| is_alive(*pid)) || !leftovers(instance).is_empty() {
        assert!(
            begun.elapsed() < 10 * SECOND,
            "{stages:?} {:?}",
            leftovers(instance)
        );
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn a_crash_of_everything_is_wiped_by_the_next_start() {
    let setting = Setting::new("crash", 2);
    let mut run = setting.up(&["--loop"]);
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
        !leftovers(&setting.instance).is_empty(),
        "a crash leaves files: else this test shows nothing"
    );
    let again = setting.run(&[]);
    assert_eq!(
        (again.code, again.frames().len()),
        (Some(0), 2),
        "{}",
        again.log
    );
}
