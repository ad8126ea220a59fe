//! Stages die and are restarted; everything ends when asked, and leaves nothing.

use mluc_ipc_types::Health;
use mluc_runtime::{Instance, Shell, Shutdown};
use mluc_tests::{Finished, Setting, is_alive, leftovers, mluc_program, send_signal, wait_for};
use rustix::process::Signal;
use std::time::{Duration, Instant};

const SECOND: Duration = Duration::from_secs(1);

/// The signal hits each stage once, and each stage gets a new process.
fn each_stage_is_replaced(signal: Signal, label: &str) -> Finished {
    let setting = Setting::new(label, 200);
    let mut run = setting.up("");
    for stage in ["backbone", "head", "refiner", "ingest"] {
        run.wait_for_lines(3);
        // Three heartbeats: by then the supervisor knows that the stage has published.
        std::thread::sleep(Duration::from_millis(300));
        run.replace(stage, signal);
    }
    let finished = setting.finish(run);
    finished.assert_complete(3, 200);
    finished.assert_says(&["0 lost; stages restarted: 4"]);
    finished
}

#[test]
fn each_killed_stage_comes_back_and_no_frame_is_lost() {
    each_stage_is_replaced(Signal::KILL, "kill").assert_says(&["restart in 0ns"]);
}

#[test]
fn each_stopped_stage_is_killed_and_comes_back_and_no_frame_is_lost() {
    let finished = each_stage_is_replaced(Signal::STOP, "stop");
    let words = "(heartbeat_max_ms of [stages.";
    let hangs = finished.log.matches(words).count();
    assert_eq!(hangs, 4, "{}", finished.log);
}

#[test]
fn a_refiner_behind_a_script_is_killed_and_ends_with_it() {
    let setting = Setting::new("script", 3);
    let script = format!("{} stage refiner; true", mluc_program().display());
    let config = format!("[stages.refiner]\ncommand = [\"sh\", \"-c\", {script:?}]\n");
    let mut run = setting.up(&format!("{} --loop", setting.config(&config)));
    run.wait_for_lines(3);
    std::thread::sleep(Duration::from_millis(300));
    let stopped = run.stage("refiner");
    send_signal(stopped, Signal::STOP);
    run.wait_for_words("hangs");
    run.wait_for_lines(3);
    let refiner = run.stage("refiner");
    run.signal(Signal::TERM);
    setting.finish(run);
    let all_gone = || !is_alive(stopped) && !is_alive(refiner);
    assert!(wait_for(10 * SECOND, all_gone), "{stopped} {refiner}");
}

#[test]
fn a_foreign_stage_that_outlives_its_supervisor_is_ended_by_the_next() {
    let setting = Setting::new("orphan", 3);
    let program = mluc_program().display().to_string();
    let script = format!("trap '' TERM HUP; {program} stage refiner; true");
    let config = format!("[stages.refiner]\ncommand = [\"sh\", \"-c\", {script:?}]\n");
    let options = format!("{} --loop", setting.config(&config));
    let mut killed = setting.up(&options);
    killed.wait_for_lines(2);
    let orphan = killed.stage("refiner");
    send_signal(orphan, Signal::STOP);
    killed.signal(Signal::KILL);
    let mut next = setting.up(&options);
    next.wait_for_words("does not end: killed");
    next.wait_for_lines(2);
    assert!(wait_for(10 * SECOND, || !is_alive(orphan)), "{}", next.log());
    setting.stop(next);
    killed.finish();
}

#[test]
fn a_stage_of_somebody_else_is_reported_and_never_signalled() {
    let setting = Setting::new("silent", 3);
    let mut run = setting.up("--without refiner --loop");
    run.wait_until("our stages run", |run| run.stages().len() == 3);
    let own = setting.stage("refiner", &setting.instance);
    run.wait_for_lines(3);
    send_signal(own.pid(), Signal::STOP);
    run.wait_for_words("no heartbeat for");
    assert!(is_alive(own.pid()));
    send_signal(own.pid(), Signal::CONT);
    run.wait_for_words("heartbeats again");
    run.wait_for_lines(3);
    run.stop();
}

#[test]
fn an_ingest_of_somebody_else_goes_on_behind_the_one_before_it_and_ends_the_run_with_its_input() {
    let setting = Setting::new("ingest", 3);
    let mut run = setting.up("--without ingest --loop");
    run.wait_until("our stages run", |run| run.stages().len() == 3);
    for _ in 0..2 {
        let ingest = setting.stage("ingest --loop", &setting.instance);
        run.wait_for_lines(3);
        ingest.stop();
    }
    let run = setting.stop(run);
    run.assert_complete(0, run.lines.len() as u64);
    // A run ends when its input ends.
    let run = setting.up("--without ingest");
    let _ingest = setting.stage("ingest", &setting.instance);
    setting.finish(run).assert_complete(0, 3);
}

#[test]
fn an_ingest_that_is_asked_to_end_before_it_knows_its_run_says_so() {
    let setting = Setting::new("early", 1);
    let instance = Instance::new(&setting.instance).expect("a name");
    // This shell has begun the run, but does not describe it.
    let other = Shell::observer(&instance, Some("run"), Shutdown::default()).expect("alone");
    let mut watch = other.health_watch().expect("it runs");
    let mut heard = || watch.update().expect("it runs")[0];
    let ingest = setting.stage("ingest", &setting.instance);
    assert!(wait_for(10 * SECOND, || heard().is_some()));
    ingest.stop();
    let last = heard().expect("heartbeats");
    assert_eq!(last.reason(), Health::ASKED_TO_END);
}

/// Time from the signal until everything has ended.
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
        // Tests run in parallel on few cores: the best of three shows the time that the program itself needs.
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
    // The supervisor is stopped, so that it cannot see its stages die.
    run.signal(Signal::STOP);
    let stages = run.stages();
    for (_, pid) in &stages {
        send_signal(*pid, Signal::KILL);
    }
    run.signal(Signal::KILL);
    drop(run);
    // A killed process keeps its lock until the kernel has freed its memory.
    let all_dead = || !stages.iter().any(|(_, pid)| is_alive(*pid));
    assert!(wait_for(10 * SECOND, all_dead), "{stages:?}");
    assert!(!leftovers(&setting.instance).is_empty(), "else this test shows nothing");
    setting.run("").assert_complete(0, 2);
}

#[test]
fn a_stage_that_is_stopped_before_its_first_frame_is_killed_once_it_was_ready() {
    let setting = Setting::new("idle", 2);
    setting.write_hanging_scan("000000");
    let mut run = setting.up("--loop");
    run.wait_for_health(&setting.instance, "the refiner is ready", |watch| {
        watch.is_ready(mluc_ipc_types::Stage::Refiner)
    });
    run.replace("refiner", Signal::STOP);
    run.wait_for_words("(heartbeat_max_ms of [stages.refiner])");
}
