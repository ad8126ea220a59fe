//! The parts of a source's contract, one function each.

use super::Session;
use crate::program::Program;
use crate::suite::{Case, Outcome, wrong_instance};
use anyhow::{Context, ensure};
use mluc_ipc_types::{Health, HealthState, Stage};
use mluc_runtime::monotonic_ns;
use std::time::{Duration, Instant};

/// The number of scans that a case takes.
const SCANS: u64 = 5;
/// How long a case waits while stages are missing.
const WAIT: Duration = Duration::from_secs(1);
const HEARTBEATS: Duration = Duration::from_millis(2500);
const GAP_MAX: Duration = Duration::from_secs(1);
/// An input that has not ended by then is treated as a sensor.
const END_MAX: Duration = Duration::from_secs(60);

pub(super) const CASES: &[Case<Session>] = &[
    ("start", start),
    ("scans", scans),
    ("heartbeats", heartbeats),
    ("second", second),
    ("new_run", new_run),
    ("restart", restart),
    ("wrong_version", |s| wrong_instance(&s.tested.options)),
    ("stop", stop),
    ("end", end),
];

fn start(session: &mut Session) -> Outcome {
    session.player.has_stages = false;
    session.start()?;
    let waits = |health: &Health| {
        health.state == HealthState::WaitingInput as u32 && !health.reason().is_empty()
    };
    let health = session.await_health("heartbeat waiting_input with a reason", waits)?;
    let begun = Instant::now();
    while begun.elapsed() < WAIT {
        session.player.tick()?;
        ensure!(
            session.player.take()?.is_none(),
            "a scan came before backbone, head and refiner were there: it is lost"
        );
        session.tested.check_alive("waiting for the stages")?;
    }
    session.tested.terminate()?;
    check_last_words(session, Health::ASKED_TO_END)?;
    Ok(format!("waits: '{}'", health.reason()))
}

fn scans(session: &mut Session) -> Outcome {
    let last = session.checked_many(0, SCANS)?;
    let is_running = |health: &Health| {
        let state = HealthState::Running as u32;
        health.state == state && health.frames_out >= SCANS
    };
    session.await_health("heartbeat running that counts the scans", is_running)?;
    let (name, points) = (last.header.name(), last.header.points_in);
    Ok(format!("{SCANS} in order, '{name}' has {points} points"))
}

fn heartbeats(session: &mut Session) -> Outcome {
    session.checked(0)?;
    let (begun, mut longest) = (Instant::now(), Duration::ZERO);
    while begun.elapsed() < HEARTBEATS && session.tested.runs() {
        session.player.tick()?;
        session.player.take()?;
        let heard_ns = session.player.health.heard_ns(Stage::Ingest);
        longest = longest.max(Duration::from_nanos(monotonic_ns() - heard_ns));
    }
    ensure!(longest <= GAP_MAX, "no heartbeat for {longest:?}");
    Ok(format!("longest gap {} ms", longest.as_millis()))
}

fn second(session: &mut Session) -> Outcome {
    let tested = &session.tested;
    let mut second = Program::start(&tested.options.command, &tested.instance)?;
    let ended = second.end_within(tested.options.patience);
    let status = ended.context("a second process stayed in the same place")?;
    ensure!(!status.success(), "a second process ended without an error");
    let words = second.last_words()?;
    Ok(words.lines().last().unwrap_or("").to_string())
}

fn new_run(session: &mut Session) -> Outcome {
    session.checked_many(0, SCANS)?;
    session.player.begin_run()?;
    let id = session.player.run.run_id;
    let (begun, mut passed) = (Instant::now(), 0);
    let first = loop {
        let scan = session.next()?;
        if scan.header.run_id == id {
            break scan;
        }
        passed += 1;
        ensure!(begun.elapsed() < session.tested.options.patience, "scans of the run before go on");
    };
    first.check(&session.player.run, 0)?;
    session.checked_many(1, SCANS)?;
    Ok(format!("joined from 0, {passed} of the old run under way"))
}

fn restart(session: &mut Session) -> Outcome {
    session.checked_many(0, SCANS)?;
    session.tested.stop();
    while session.player.take()?.is_some() {}
    let sent = session.player.sent;
    let begun = Instant::now();
    session.start()?;
    session.checked_many(sent, 2)?;
    let seconds = begun.elapsed().as_secs_f64();
    Ok(format!("went on with scan {sent} after {seconds:.1} s"))
}

fn stop(session: &mut Session) -> Outcome {
    session.checked(0)?;
    let told = session.tested.terminate()?;
    check_last_words(session, Health::ASKED_TO_END)?;
    Ok(told)
}

fn check_last_words(session: &mut Session, expected: &str) -> anyhow::Result<()> {
    session.player.tick()?;
    let health = session.player.health.of(Stage::Ingest).copied();
    let health = health.context("no heartbeat")?;
    let (state, found) = (health.state, health.reason());
    ensure!(
        state == HealthState::Stopping as u32 && found == expected,
        "last heartbeat: expected stopping (5) with reason '{expected}', found state {state}, '{found}'"
    );
    Ok(())
}

fn end(session: &mut Session) -> Outcome {
    session.player.answers = true;
    let begun = Instant::now();
    while session.tested.runs() {
        if begun.elapsed() > END_MAX {
            return Ok(format!("no end within {END_MAX:?}: a sensor"));
        }
        session.player.tick()?;
        session.player.take()?;
    }
    let program = session.tested.program()?;
    let status = program.ended().context("it ended")?;
    ensure!(status.success(), "{status}: {}", program.last_words()?);
    check_last_words(session, "")?;
    let (sent, seconds) = (session.player.sent, begun.elapsed().as_secs_f64());
    Ok(format!("ended after {sent} scans, {seconds:.1} s"))
}
