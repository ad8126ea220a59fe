//! Runs of frames, valid sequences in a run, and a side that was built with another contract or runs another model.

use super::Outcome;
use crate::suite::{names_both, wrong_instance};
use crate::{refiner::answer::is_flagged, refiner::session::Session};
use anyhow::{Context, ensure};
use mluc_ipc_types::{Flags, Health, WIRE_VERSION};

/// A run that differs from all runs of the suite, whose ids are random.
const OTHER_RUN: u64 = 1;

pub(super) fn sequences(session: &mut Session) -> Outcome {
    session.ask_usual()?;
    session.ask_usual()?;
    let last = session.player.next_sequence - 1;
    let hostile = [
        ("sequence 2^64-1", u64::MAX),
        ("sequence 2^64-2", u64::MAX - 1),
        ("a sequence far ahead of what was sent", last + 1_000_000),
        ("a sequence that goes back", last - 1),
    ];
    for (what, sequence) in hostile {
        let mut frame = session.player.usual();
        // Its points keep their own sequence.
        frame.header.sequence = sequence;
        session.must_refuse(what, frame)?;
    }
    let count = hostile.len();
    Ok(format!("{count} refused, each sound one after it answered"))
}

pub(super) fn other_run(session: &mut Session) -> Outcome {
    let mut frame = session.player.usual();
    frame.header.run_id = OTHER_RUN;
    session.must_refuse("a frame of another run", frame)?;
    // Points of another run have the sequence of a frame of this run; the points of this run's next frame are sent first.
    let mut frame = session.player.usual();
    frame.points_header.as_mut().context("points")?.run_id = OTHER_RUN;
    let next = session.player.usual();
    session.player.send_points(&next)?;
    let answer = session.ask(&mut frame)?;
    ensure!(
        is_flagged(&answer, &[Flags::POINTS_GONE]),
        "points of another run were taken for the frame's own"
    );
    Ok("frame and points of another run are not used".to_string())
}

pub(super) fn new_run(session: &mut Session) -> Outcome {
    session.ask_usual()?;
    let old = session.player.usual();
    let id = session.player.begin_run()?;
    let is_of_run = |health: &Health| health.run_id == id;
    session.await_health("heartbeat with the id of the new run", is_of_run)?;
    session.ask_after("the new run began, from sequence 0")?;
    session.must_refuse("a frame of the run before", old)?;
    Ok("joined; sequences begin at 0; the run before is over".to_string())
}

pub(super) fn wrong_version(session: &mut Session) -> Outcome {
    let reason = wrong_messages(session)?;
    let line = wrong_instance(&session.tested.options)?;
    Ok(format!("message: '{reason}'; instance: '{line}'"))
}

/// Messages of another version, and of another model.
fn wrong_messages(session: &mut Session) -> anyhow::Result<String> {
    let mut frame = session.player.usual();
    let other = WIRE_VERSION + 41;
    frame.header.wire_version = other;
    let reason = session.must_refuse(&format!("detections of wire version {other}"), frame)?;
    ensure!(
        names_both(&reason, other),
        "detections of wire version {other} were refused with the reason '{reason}': it should name both versions, \
         {WIRE_VERSION} and {other}"
    );
    let mut frame = session.player.usual();
    frame.header.model_fingerprint ^= 0xffff;
    session.must_refuse("detections of another model (fingerprint)", frame)?;
    Ok(reason)
}
