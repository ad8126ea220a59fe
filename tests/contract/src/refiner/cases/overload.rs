//! More frames than it can take.

use std::time::{Duration, Instant};

use anyhow::{Context, bail, ensure};
use rustix::process::Signal;

use super::Outcome;
use crate::refiner::frame::Sent;
use crate::refiner::scene::usual;
use crate::refiner::session::{Session, describe};

/// Frames that come while the program is held.
const HELD: usize = 10;
/// Frames sent as fast as the suite can.
const BURST: usize = 60;
/// A topic's queue, and one frame in work.
const ANSWERS_MAX: usize = 3;

pub(super) fn overload(session: &mut Session<'_>) -> Outcome {
    session.ready()?;
    // A first frame, so that gaps can be counted from it.
    let (points, detections) = usual();
    let frame = session.player.frame(points, detections);
    session.ask(&frame)?;

    let before = dropped(session)?;
    session.program()?.signal(Signal::STOP);
    std::thread::sleep(Duration::from_millis(50));
    let held = flood(session, HELD, Duration::from_millis(5), before, true)?;
    ensure!(
        held.answered <= ANSWERS_MAX,
        "held back while {HELD} frames came, it answered {} of them: old ones are to be passed over",
        held.answered
    );
    let before = dropped(session)?;
    let burst = flood(session, BURST, Duration::ZERO, before, false)?;
    Ok(format!(
        "held: {} of {HELD} answered, {} dropped and counted; burst: {} of {BURST} answered, {} dropped and counted",
        held.answered, held.dropped, burst.answered, burst.dropped
    ))
}

/// What its health counts now.
fn dropped(session: &mut Session<'_>) -> anyhow::Result<u64> {
    let patience = session.options.patience;
    let heard = session.player.await_health(patience, |_| true)?;
    Ok(heard.context("no heartbeat")?.frames_dropped)
}

struct Flood {
    answered: usize,
    dropped: u64,
}

fn flood(
    session: &mut Session<'_>,
    count: usize,
    pause: Duration,
    before: u64,
    is_held: bool,
) -> anyhow::Result<Flood> {
    let patience = session.options.patience;
    let (points, detections) = usual();
    let mut last: Option<Sent> = None;
    let mut sequences = Vec::new();
    for _ in 0..count {
        let frame = session.player.frame(points.clone(), detections.clone());
        last = Some(session.player.send(&frame)?);
        std::thread::sleep(pause);
        collect(session, &mut sequences)?;
    }
    if is_held {
        session.program()?.signal(Signal::CONT);
    }
    let Some(last) = last else {
        bail!("nothing was sent")
    };
    let begun = Instant::now();
    while sequences.last() != Some(&last.header.sequence) {
        collect(session, &mut sequences)?;
        session.check_alive("it was flooded")?;
        ensure!(
            begun.elapsed() < patience,
            "the newest of {count} frames ({}) was not answered; answered were {sequences:?}",
            last.header.sequence
        );
        session.player.wait();
    }
    ensure!(
        sequences.is_sorted_by(|a, b| a < b),
        "frames were answered out of order: {sequences:?}"
    );
    let expected = (count - sequences.len()) as u64;
    let counted = |health: &mluc_ipc_types::Health| health.frames_dropped == before + expected;
    let heard = session.player.await_health(patience, counted)?;
    if heard.is_none() {
        let said = session.player.health()?;
        bail!(
            "{expected} frames were overtaken, frames_dropped should be {}; health says: {}",
            before + expected,
            said.map_or("nothing".to_string(), |(health, _)| describe(&health))
        );
    }
    Ok(Flood {
        answered: sequences.len(),
        dropped: expected,
    })
}

fn collect(session: &mut Session<'_>, sequences: &mut Vec<u64>) -> anyhow::Result<()> {
    while let Some(answer) = session.player.take_answer()? {
        sequences.push(answer.header.sequence);
    }
    Ok(())
}
