//! More frames than it can take.

use std::time::Duration;

use anyhow::ensure;
use rustix::process::Signal;

use super::Outcome;
use crate::refiner::player::Player;
use crate::refiner::scene::usual;
use crate::refiner::session::Session;

/// Frames that come while the program is held.
const HELD: usize = 10;
/// Frames sent as fast as the suite can.
const BURST: usize = 60;
/// A topic's queue, and one frame in work.
const ANSWERS_MAX: usize = 3;

pub(super) fn overload(session: &mut Session<'_>) -> Outcome {
    session.ready()?;
    // A first frame, so that gaps can be counted from it.
    session.ask_usual()?;

    let before = session.fresh_health()?.frames_dropped;
    session.program()?.signal(Signal::STOP);
    std::thread::sleep(Duration::from_millis(50));
    let sequences = flood(session, HELD, Duration::from_millis(5))?;
    session.program()?.signal(Signal::CONT);
    let held = count_answers(session, HELD, sequences, before)?;
    ensure!(
        held <= ANSWERS_MAX,
        "held back while {HELD} frames came, it answered {held} of them: old ones are to be passed over"
    );
    let before = session.fresh_health()?.frames_dropped;
    let sequences = flood(session, BURST, Duration::ZERO)?;
    let burst = count_answers(session, BURST, sequences, before)?;
    let told = |answered, count| {
        let dropped = count - answered;
        format!("{answered} of {count} answered, {dropped} dropped and counted")
    };
    let (held, burst) = (told(held, HELD), told(burst, BURST));
    Ok(format!("held: {held}; burst: {burst}"))
}

/// Sends frames; gives the sequences that were answered meanwhile.
fn flood(session: &mut Session<'_>, count: usize, pause: Duration) -> anyhow::Result<Vec<u64>> {
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

/// Waits for the answer to the newest of `count` frames, and until its health counts the others as dropped; gives how many
/// were answered.
fn count_answers(
    session: &mut Session<'_>,
    count: usize,
    mut answered: Vec<u64>,
    dropped_before: u64,
) -> anyhow::Result<usize> {
    let newest = session.player.next_sequence - 1;
    let awaited = format!("objects of the newest of {count} frames, {newest}");
    session.await_any(&awaited, |player| {
        collect(player, &mut answered)?;
        Ok((answered.last() == Some(&newest)).then_some(()))
    })?;
    ensure!(
        answered.is_sorted_by(|a, b| a < b),
        "frames were answered out of order: {answered:?}"
    );
    let overtaken = (count - answered.len()) as u64;
    let dropped = dropped_before + overtaken;
    let awaited =
        format!("heartbeat with frames_dropped {dropped}, as {overtaken} frames were overtaken");
    session.await_health(&awaited, |health| health.frames_dropped == dropped)?;
    Ok(answered.len())
}

fn collect(player: &mut Player, sequences: &mut Vec<u64>) -> anyhow::Result<()> {
    while let Some(answer) = player.take_answer()? {
        sequences.push(answer.header.sequence);
    }
    Ok(())
}
