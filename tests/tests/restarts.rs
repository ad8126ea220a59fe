//! Stages die and come back; everything ends when asked, and leaves nothing.

use std::time::{Duration, Instant};

use mluc_tests::{Setting, is_alive, leftovers, send_signal, wait_for};
use rustix::process::Signal;

const SECOND: Duration = Duration::from_secs(1);

#[test]
fn each_killed_stage_comes_back_and_no_frame_is_lost() {
    let setting = Setting::new("kill", 60);
    let mut run = setting.up("");
    for (number, stage) in ["backbone", "head", "refiner", "ingest"]
        .into_iter()
        .enumerate()
    {
        run.wait_for_lines(3);
        let killed = run.stage(stage);
        send_signal(killed, Signal::KILL);
        run.wait_until("it has another process", |run| {
            let mut stages = run.stages().into_iter();
            stages.any(|(name, pid)| name == stage && pid != killed)
        });
        assert!(run.log().matches("restart in").count() > number);
    }
    let finished = setting.finish(run);
    finished.assert_complete(3, 60);
    finished.assert_says(&["0 lost; stages restarted: 4"]);
}

/// From the signal to the end of everything.
fn time_to_end(signal: Signal, pace: &str) -> Duration {
    let setting = Setting::new("term", 3);
    let mut run = setting.up(&format!("--pace {pace} --loop"));
    run.wait_for_lines(4);
    let stages = run.stages();
    assert_eq!(stages.len(), 4);
    let begun = Instant::now();
    run.signal(signal);
    let finished = setting.finish(run);
    let took = begun.elapsed();
    assert_eq!(finished.code, Some(0), "{}", finished.log);
    assert!(stages.iter().all(|(_, pid)| !is_alive(*pid)));
    took
}

#[test]
fn a_signal_ends_all_within_a_second_and_leaves_nothing() {
    for (signal, pace) in [(Signal::TERM, "complete"), (Signal::INT, "sensor")] {
        // Tests run beside each other on few cores: the best of three tells what the program needs by itself.
        let is_quick = (0..3).any(|_| time_to_end(signal, pace) < SECOND);
        assert!(is_quick, "three ends took longer than a second");
    }
}

#[test]
fn stages_end_when_their_supervisor_is_killed() {
    let setting = Setting::new("orphan", 3);
    let mut run = setting.up("--loop");
    run.wait_for_lines(2);
    let stages = run.stages();
    run.signal(Signal::KILL);
    let left = || leftovers(&setting.instance);
    let all_gone = || !stages.iter().any(|(_, pid)| is_alive(*pid)) && left().is_empty();
    assert!(wait_for(10 * SECOND, all_gone), "{stages:?} {:?}", left());
}

#[test]
fn a_crash_of_everything_is_wiped_by_the_next_start() {
    let setting = Setting::new("crash", 2);
    let mut run = setting.up("--loop");
    run.wait_for_lines(2);
    // The supervisor must not see its stages die.
    run.signal(Signal::STOP);
    let stages = run.stages();
    for (_, pid) in &stages {
        send_signal(*pid, Signal::KILL);
    }
    run.signal(Signal::KILL);
    drop(run);
    // A killed process holds its lock until the kernel has taken its memory back.
    let all_dead = || !stages.iter().any(|(_, pid)| is_alive(*pid));
    assert!(wait_for(10 * SECOND, all_dead), "{stages:?}");
    let leaves_files = !leftovers(&setting.instance).is_empty();
    assert!(leaves_files, "else this test shows nothing");
    setting.run("").assert_complete(0, 2);
}
