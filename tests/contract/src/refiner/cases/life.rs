//! Start, silence, death, end, and more frames than the program can take.

use super::Outcome;
use crate::refiner::session::{Session, describe};
use crate::{refiner::player::Player, refiner::scene::usual};
use anyhow::{Context, ensure};
use mluc_ipc_types::{Health, HealthState};
use mluc_runtime::monotonic_ns;
use rustix::process::Signal;
use std::time::{Duration, Instant};

/// Longest time between two heartbeats of a program that waits: five times the usual time.
const HEARTBEAT_MAX: Duration = Duration::from_millis(500);
/// Longer than every topic's deadline.
const SILENCE: Duration = Duration::from_millis(2500);
const KILLS: usize = 3;
/// Frames that come while the program is held.
const HELD: usize = 10;
/// Frames sent as fast as the suite can.
const BURST: usize = 60;
/// A topic's queue, and one frame in progress.
const ANSWERS_MAX: usize = 3;

pub(super) fn start(session: &mut Session) -> Outcome {
    session.tested.stop();
    let begun = Instant::now();
    let health = session.start()?;
    let took = begun.elapsed();
    check_waiting(&health)?;
    let (seconds, reason) = (took.as_secs_f64(), health.reason());
    Ok(format!("ready after {seconds:.2} s: '{reason}'"))
}

fn check_waiting(health: &Health) -> anyhow::Result<()> {
    let (_, state) = health.checked()?;
    ensure!(
        state == HealthState::WaitingInput && !health.reason().is_empty(),
        "without input health should be waiting_input with a reason, it is: {}",
        describe(health)
    );
    Ok(())
}

pub(super) fn silence(session: &mut Session) -> Outcome {
    session.ask_usual()?;
    let running = |health: &Health| health.state == HealthState::Running as u32;
    session.await_health("heartbeat with state running after a frame", running)?;
    let begun = Instant::now();
    let mut longest = Duration::ZERO;
    while begun.elapsed() < SILENCE {
        let awaited = "heartbeats while nothing came in";
        session.tested.check_alive(awaited)?;
        let heard_ns = session.player.heard_ns()?;
        let ago_ns = monotonic_ns().saturating_sub(heard_ns);
        longest = longest.max(Duration::from_nanos(ago_ns));
        std::thread::sleep(Duration::from_millis(10));
    }
    let longest_ms = longest.as_millis();
    ensure!(longest < HEARTBEAT_MAX, "no heartbeat for {longest_ms} ms; one is due every 100 ms");
    check_waiting(&session.fresh_health()?)?;
    session.ask_usual()?;
    Ok(format!(
        "waited {SILENCE:?}, longest gap between heartbeats {longest_ms} ms; the next frame was answered"
    ))
}

pub(super) fn restart(session: &mut Session) -> Outcome {
    let mut slowest = Duration::ZERO;
    for kill in 0..KILLS {
        let mut frame = session.player.usual();
        session.player.send(&mut frame)?;
        // Roughly in the middle of its work.
        std::thread::sleep(Duration::from_micros(300 * kill as u64));
        session.tested.program()?.kill();
        let begun = Instant::now();
        session.start().with_context(|| format!("after kill -9 number {}", kill + 1))?;
        session.ask_usual()?;
        slowest = slowest.max(begun.elapsed());
    }
    let seconds = slowest.as_secs_f64();
    Ok(format!("killed {KILLS} times; back with an answer within {seconds:.2} s"))
}

pub(super) fn overload(session: &mut Session) -> Outcome {
    // A first frame, from which gaps can be counted.
    session.ask_usual()?;

    let before = session.fresh_health()?;
    session.tested.program()?.signal(Signal::STOP);
    std::thread::sleep(Duration::from_millis(50));
    let sequences = flood(session, HELD, Duration::from_millis(5))?;
    session.tested.program()?.signal(Signal::CONT);
    let held = count_answers(session, HELD, sequences, before)?;
    ensure!(
        held <= ANSWERS_MAX,
        "held back while {HELD} frames came, it answered {held} of them: old ones are to be passed over"
    );
    let before = session.fresh_health()?;
    let sequences = flood(session, BURST, Duration::ZERO)?;
    let burst = count_answers(session, BURST, sequences, before)?;
    let told = |answered, count| {
        let dropped = count - answered;
        format!("{answered} of {count} answered, {dropped} dropped and counted")
    };
    let (held, burst) = (told(held, HELD), told(burst, BURST));
    Ok(format!("held: {held}; burst: {burst}"))
}

/// Sends frames; returns the sequences that were answered meanwhile.
fn flood(session: &mut Session, count: usize, pause: Duration) -> anyhow::Result<Vec<u64>> {
    let player = &mut session.player;
    let (points, detections) = usual();
    let mut answered = Vec::new();
    for _ in 0..count {
        let mut frame = player.frame(points.clone(), detections.clone());
        player.send(&mut frame)?;
        std::thread::sleep(pause);
        collect(player, &mut answered)?;
    }
    Ok(answered)
}

/// Waits for the answer to the newest of `count` frames, and until the program's health counts each as published or dropped. Returns
/// how many were published. This includes answers that later ones pushed out before this process took them.
fn count_answers(
    session: &mut Session,
    count: usize,
    mut answered: Vec<u64>,
    before: Health,
) -> anyhow::Result<usize> {
    let newest = session.player.next_sequence - 1;
    let awaited = format!("objects of the newest of {count} frames, {newest}");
    session.await_any(&awaited, |player| {
        collect(player, &mut answered)?;
        Ok((answered.last() == Some(&newest)).then_some(()))
    })?;
    ensure!(answered.is_sorted_by(|a, b| a < b), "frames were answered out of order: {answered:?}");
    let seen = answered.len() as u64;
    let total = before.frames_out + before.frames_dropped + count as u64;
    let awaited = format!(
        "heartbeat with {total} frames in frames_out and frames_dropped together, at least {} of them in frames_out",
        before.frames_out + seen
    );
    let health = session.await_health(&awaited, |health| {
        health.frames_out >= before.frames_out + seen
            && health.frames_out + health.frames_dropped == total
    })?;
    Ok((health.frames_out - before.frames_out) as usize)
}

fn collect(player: &mut Player, sequences: &mut Vec<u64>) -> anyhow::Result<()> {
    while let Some(answer) = player.take_answer()? {
        sequences.push(answer.header.sequence);
    }
    Ok(())
}
