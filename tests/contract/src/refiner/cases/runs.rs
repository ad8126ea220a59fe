//! Which run a frame belongs to, and which sequences that run may have.

use anyhow::{Context, bail, ensure};
use mluc_ipc_types::Flags;

use super::Outcome;
use crate::refiner::answer::{check_form, is_flagged};
use crate::refiner::frame::Frame;
use crate::refiner::scene::usual;
use crate::refiner::session::{Reaction, Session};

/// Another run than any of the suite's, whose ids are random.
const OTHER_RUN: u64 = 1;

fn usual_frame(session: &mut Session<'_>) -> Frame {
    let (points, detections) = usual();
    session.player.frame(points, detections)
}

fn ask_sound(session: &mut Session<'_>, after: &str) -> anyhow::Result<()> {
    let frame = usual_frame(session);
    let asked = session.ask(&frame);
    asked.with_context(|| format!("the sound frame after {after}"))?;
    Ok(())
}

/// The frame must be refused, and the next sound one answered.
fn must_refuse(session: &mut Session<'_>, what: &str, frame: &Frame) -> anyhow::Result<()> {
    match session.provoke(frame).with_context(|| what.to_string())? {
        Reaction::Answered(_) => bail!("{what}: answered, it should be refused"),
        Reaction::Refused(_) => ask_sound(session, what),
    }
}

pub(super) fn sequences(session: &mut Session<'_>) -> Outcome {
    session.ready()?;
    ask_sound(session, "the start")?;
    ask_sound(session, "the first")?;
    let last = session.player.next_sequence() - 1;
    let hostile = [
        ("sequence 2^64-1", u64::MAX),
        ("sequence 2^64-2", u64::MAX - 1),
        ("a sequence far ahead of what was sent", last + 1_000_000),
        ("a sequence that goes back", last - 1),
    ];
    for (what, sequence) in hostile {
        let mut frame = usual_frame(session);
        frame.header.sequence = sequence;
        // Its points come under the number that is theirs.
        must_refuse(session, what, &frame)?;
    }
    Ok(format!(
        "{} refused, each sound frame after them answered",
        hostile.len()
    ))
}

pub(super) fn other_run(session: &mut Session<'_>) -> Outcome {
    session.ready()?;
    let mut frame = usual_frame(session);
    frame.header.run_id = OTHER_RUN;
    must_refuse(session, "a frame of another run", &frame)?;
    // Points of another run under the sequence of a frame of this one, which sent its own later.
    let mut frame = usual_frame(session);
    let header = frame.points_header.as_mut().context("points")?;
    header.run_id = OTHER_RUN;
    let next = usual_frame(session);
    session.player.send_points(&next)?;
    let mut sent = session.player.send(&frame)?;
    sent.points = 0;
    let answer = session.await_answer(&sent)?;
    check_form(&sent, &answer, session.options.classes.len())?;
    ensure!(
        is_flagged(&answer, &[Flags::POINTS_GONE]),
        "points of another run were taken for the frame's own"
    );
    Ok("frame and points of another run are not used".to_string())
}

pub(super) fn new_run(session: &mut Session<'_>) -> Outcome {
    session.ready()?;
    ask_sound(session, "the start")?;
    let old = usual_frame(session);
    let id = session.player.begin_run()?;
    let patience = session.options.patience;
    let joined = session
        .player
        .await_health(patience, |health| health.run_id == id)?;
    joined.context("no heartbeat carries the id of the new run")?;
    ask_sound(session, "the new run began, from sequence 0")?;
    must_refuse(session, "a frame of the run before", &old)?;
    Ok("joined; sequences begin at 0; the run before is over".to_string())
}
