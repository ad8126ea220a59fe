//! The supervisor, with any behaviour of the reader of its lines, any way to end it, and any way in which it ended before.

use mluc_ipc_types::Stage;
use mluc_tests::{Running, Setting, assert_has, is_alive, leftovers, send_signal, wait_for};
use rustix::process::Signal;
use std::io::{PipeReader, PipeWriter, Write};
use std::process::{Command, Stdio};
use std::{fs::File, os::unix::net::UnixDatagram, time::Duration};

const SECOND: Duration = Duration::from_secs(1);
/// The capacity of a pipe.
const PIPE_BYTES: usize = 1 << 16;

/// A pipe that is full until it is read.
fn full_pipe() -> (PipeReader, PipeWriter) {
    let (reader, mut writer) = std::io::pipe().expect("a pipe");
    writer.write_all(&[b'\n'; PIPE_BYTES]).expect("room for so much");
    (reader, writer)
}

#[test]
fn a_reader_that_stands_still_stops_no_restart_and_gets_every_line_at_pace_complete() {
    let setting = Setting::new("stalled", 80);
    let options = setting.config("restart_limit = 1");
    // A stage ended from outside is restarted. A stage that dies by itself ends the run, with 32 lines waiting.
    for (signal, words, code, least) in
        [(Signal::TERM, "restart in", 3, 80), (Signal::ABORT, "ended: signal", 1, 32)]
    {
        let (reader, writer) = full_pipe();
        let mut command = setting.up_command(&options);
        let mut run = Running::start_into(&mut command, writer.into(), Stdio::piped());
        drop(command);
        // The supervisor has paused ingest, because enough lines are waiting.
        run.wait_for_health(&setting.instance, "ingest waits", |watch| {
            let ingest = watch.of(Stage::Ingest);
            ingest.is_some_and(|health| health.reason().contains("reader of the lines"))
        });
        send_signal(run.stage("refiner"), signal);
        run.wait_for_words(words);
        let read = std::thread::spawn(|| std::io::read_to_string(reader));
        let run = setting.finish(run);
        assert_eq!(run.code, Some(code), "{}", run.log);
        let text = read.join().expect("no panic").expect("read");
        let lines: Vec<&str> = text.trim_start().lines().collect();
        assert!(lines.len() >= least, "{}", lines.len());
        for (number, line) in lines.into_iter().enumerate() {
            assert_has(line, &[&format!("\"sequence\":{number},")]);
            assert!(line.ends_with('}'), "{line}");
        }
    }
}

#[test]
fn a_reader_that_stands_still_loses_lines_at_the_sensors_pace_and_signals_end_the_run() {
    let setting = Setting::new("stalled", 3);
    let (_reader, writer) = full_pipe();
    let mut command = setting.up_command("--pace sensor --rate 100 --loop");
    let mut run = Running::start_into(&mut command, writer.into(), Stdio::piped());
    run.wait_until("all stages run", |run| run.stages().len() == 4);
    let what = "more frames came than may wait";
    run.wait_for_health(&setting.instance, what, |watch| {
        watch.of(Stage::Refiner).is_some_and(|health| health.frames_out > 100)
    });
    run.replace("refiner", Signal::KILL);
    let finished = setting.stop(run);
    finished.assert_ended(0, 0);
    finished.assert_says(&["lines dropped", "frames: "]);
}

#[test]
fn a_log_that_nobody_reads_stops_no_restart_and_says_what_was_lost() {
    let setting = Setting::new("unread", 3);
    let (reader, writer) = full_pipe();
    let mut command = setting.up_command("--loop");
    let mut run = Running::start_into(&mut command, Stdio::piped(), writer.into());
    drop(command);
    run.wait_for_lines(1);
    run.replace("refiner", Signal::KILL);
    run.wait_for_lines(3);
    let read = std::thread::spawn(|| std::io::read_to_string(reader));
    // Now the reader starts.
    std::thread::sleep(SECOND);
    setting.stop(run);
    let log = read.join().expect("no panic").expect("read");
    assert_has(&log, &["messages were lost", "frames: "]);
}

#[test]
fn lines_that_cannot_be_written_end_the_run_with_an_error() {
    let setting = Setting::new("unwritable", 3);
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    let full = File::options().write(true).open("/dev/full");
    let cases: [(Stdio, &str); 2] = [
        (writer.into(), "its reader is gone"),
        (full.expect("Linux has it").into(), "No space left"),
    ];
    for (stdout, words) in cases {
        let mut command = setting.up_command("--loop");
        let run = Running::start_into(&mut command, stdout, Stdio::piped());
        let finished = setting.finish(run);
        finished.assert_ended(1, 0);
        finished.assert_says(&["standard output", words]);
    }
}

#[test]
fn signals_that_the_parent_ignores_change_nothing() {
    let setting = Setting::new("ignored", 2);
    let mluc = setting.up_command("");
    let mut command = Command::new("sh");
    command.args(["-c", "trap '' CHLD HUP; exec \"$0\" \"$@\""]);
    command.arg(mluc.get_program()).args(mluc.get_args());
    setting.finish(Running::start(&mut command)).assert_complete(0, 2);
}

#[test]
fn a_supervisor_that_was_killed_is_followed_at_once_by_the_next() {
    let setting = Setting::new("again", 2);
    for stopped in [None, None, Some("backbone"), Some("ingest")] {
        let mut run = setting.up("--loop");
        run.wait_for_lines(1);
        let stages = run.stages();
        if let Some(stage) = stopped {
            send_signal(run.stage(stage), Signal::STOP);
        }
        run.signal(Signal::KILL);
        setting.run("").assert_complete(0, 2);
        let all_gone = || !stages.iter().any(|(_, pid)| is_alive(*pid));
        assert!(wait_for(10 * SECOND, all_gone), "{stages:?}");
    }
}

#[test]
fn a_stage_of_somebody_else_outlives_a_killed_supervisor_and_serves_the_next() {
    let setting = Setting::new("outlives", 2);
    let mut first = setting.up("--loop --without refiner");
    first.wait_until("our stages run", |run| run.stages().len() == 3);
    let refiner = setting.stage("refiner", &setting.instance);
    first.wait_for_lines(2);
    first.signal(Signal::KILL);
    setting.up("--without refiner").finish().assert_complete(0, 2);
    refiner.stop().assert_ended(0, 0);
    assert_eq!(leftovers(&setting.instance), [""; 0]);
}

#[test]
fn a_start_waits_for_a_predecessor_that_is_leaving() {
    let setting = Setting::new("leaving", 2);
    for _ in 0..5 {
        let mut first = setting.up("--loop");
        first.wait_for_lines(1);
        first.signal(Signal::TERM);
        setting.run("").assert_complete(0, 2);
        assert_eq!(first.finish().code, Some(0));
    }
}

#[test]
fn a_supervisor_that_is_stopped_is_no_predecessor_and_goes_on_afterwards() {
    let setting = Setting::new("paused", 2);
    let mut first = setting.up("--loop");
    first.wait_for_lines(2);
    first.signal(Signal::STOP);
    let second = setting.up("").finish();
    second.assert_ended(1, 0);
    second.assert_says(&["pipeline", "--instance"]);
    second.assert_says(&[&setting.instance, &first.pid().to_string()]);
    first.signal(Signal::CONT);
    first.wait_for_lines(5);
    // The supervisor saw no silent stage.
    setting.stop(first).assert_says(&["stages restarted: 0"]);
}

#[test]
fn of_two_starts_at_once_one_runs() {
    let setting = Setting::new("twice", 2);
    let mut both = [setting.up("--loop"), setting.up("--loop")];
    let mut refused = None;
    wait_for(30 * SECOND, || {
        refused = both.iter().position(|run| run.log().contains("--instance"));
        refused.is_some()
    });
    let refused = refused.expect("one is refused");
    both[1 - refused].wait_for_lines(3);
    let mut both = Vec::from(both);
    both.remove(refused).finish().assert_ended(1, 0);
    setting.stop(both.remove(0));
    assert!(wait_for(SECOND, || leftovers(&setting.instance).is_empty()));
}

/// The messages that systemd gets from a service of `Type=notify` with `WatchdogSec=1`.
#[test]
fn a_service_manager_hears_that_the_run_is_ready_lives_and_ends() {
    let setting = Setting::new("notify", 2);
    let path = setting.folder.path().join("notify");
    let socket = UnixDatagram::bind(&path).expect("a socket");
    socket.set_read_timeout(Some(30 * SECOND)).expect("a timeout");
    let hear = || {
        let mut text = [0; 64];
        let count = socket.recv(&mut text).expect("a word in time");
        String::from_utf8_lossy(&text[..count]).into_owned()
    };
    let mut command = setting.up_command("--loop");
    command.env("NOTIFY_SOCKET", &path);
    command.env("WATCHDOG_USEC", "1000000");
    let run = Running::start(&mut command);
    let mut heard = vec![hear()];
    let count = |heard: &[String], word: &str| heard.iter().filter(|own| *own == word).count();
    while count(&heard, "READY=1") < 1 || count(&heard, "WATCHDOG=1") < 3 {
        heard.push(hear());
    }
    run.signal(Signal::TERM);
    while heard.last().is_some_and(|word| word != "STOPPING=1") {
        heard.push(hear());
    }
    assert_eq!(setting.finish(run).code, Some(0));
    heard.retain(|word| word != "WATCHDOG=1");
    assert_eq!(heard, ["READY=1", "STOPPING=1"]);
}
