//! Frames that sound stages may send.

use super::Outcome;
use crate::refiner::scene::{CAR, CART, Thing, blob, candidate, known, scan, usual};
use crate::{refiner::answer::is_flagged, refiner::player::Answer, refiner::session::Session};
use anyhow::ensure;
use mluc_ipc_types::{CandidateCounts, DETECTIONS_MAX, Detection, Flags, POINTS_MAX, Point};

pub(super) fn scene(session: &mut Session) -> Outcome {
    let before = session.fresh_health()?.candidates;
    let (frame, answer) = session.ask_usual()?;
    let unknown = &answer.objects[1];
    let off_m = (unknown.center_m[0] - CART.x_m).hypot(unknown.center_m[1] - CART.y_m);
    let after = session.fresh_health()?.candidates;
    Ok(format!(
        "answered in {:.1} ms; the unknown object has {} points and lies {off_m:.2} m off; {}",
        answer.took_ms(&frame),
        unknown.points_count,
        check_counts(before, &answer, after)?
    ))
}

/// A program that counts candidates must count correctly; zeros are allowed.
fn check_counts(
    before: CandidateCounts,
    answer: &Answer,
    after: CandidateCounts,
) -> anyhow::Result<&'static str> {
    if after == CandidateCounts::default() {
        return Ok("health does not count candidates");
    }
    let mut expected = before;
    expected.add(&answer.objects);
    ensure!(
        after == expected,
        "after a frame health should count the candidates {expected:?}, it says {after:?}"
    );
    Ok("health counts the candidates")
}

pub(super) fn empty(session: &mut Session) -> Outcome {
    let (points, detections) = usual();
    for (points, detections) in [
        (vec![], vec![]),
        (points.clone(), vec![]),
        (vec![], detections.clone()),
        (points, vec![]),
        (vec![], detections),
    ] {
        let mut frame = session.player.frame(points, detections);
        if frame.points.is_empty() {
            frame.header.flags |= Flags::EMPTY.0;
        }
        let answer = session.ask(&mut frame)?;
        ensure!(
            !is_flagged(&answer, &[Flags::POINTS_GONE]),
            "a scan without points is flagged points_gone, although it came"
        );
    }
    Ok("5 frames answered".to_string())
}

/// The slowest answer to the frames, ms.
fn slowest(session: &mut Session, frames: [(Vec<Point>, Vec<Detection>); 3]) -> Outcome {
    let mut slowest_ms = 0.0f64;
    for (points, detections) in frames {
        let mut frame = session.player.frame(points, detections);
        let answer = session.ask(&mut frame)?;
        slowest_ms = slowest_ms.max(answer.took_ms(&frame));
    }
    Ok(format!("3 answered, the slowest in {slowest_ms:.1} ms"))
}

fn spread(number: usize) -> Thing {
    let angle = number as f32 * 2.4;
    let range = 5.0 + number as f32 * 0.09;
    Thing { x_m: range * angle.cos(), y_m: range * angle.sin(), ..CART }
}

pub(super) fn candidates(session: &mut Session) -> Outcome {
    let shifts = (0..DETECTIONS_MAX).map(|number| [number as f32 * 0.001, 0.0]);
    let on_one_spot = shifts.map(|shift_m| candidate(&CART, shift_m)).collect();
    let things: Vec<Thing> = (0..DETECTIONS_MAX).map(spread).collect();
    let off = |thing: &Thing| candidate(thing, [0.2, 0.1]);
    let everywhere = things.iter().map(off).collect();
    let all_known = things.iter().map(known).collect();
    let frames = [
        (scan(&[CART, CAR], 20_000), on_one_spot),
        (scan(&things, 60_000), everywhere),
        (scan(&things, 60_000), all_known),
    ];
    slowest(session, frames)
}

pub(super) fn points(session: &mut Session) -> Outcome {
    let shifts = (0..20).map(|number| number as f32 * 0.02);
    let off = |shift: f32| candidate(&CART, [shift, -shift]);
    let detections: Vec<_> = shifts.map(off).collect();
    let scans = [
        scan(&[CART, CAR], POINTS_MAX),
        blob(&CART, POINTS_MAX),
        vec![Point::default(); POINTS_MAX],
    ];
    slowest(session, scans.map(|points| (points, detections.clone())))
}

pub(super) fn points_gone(session: &mut Session) -> Outcome {
    let mut of_another = session.player.usual();
    if let Some(header) = &mut of_another.points_header {
        header.sequence += 1_000_000;
    }
    let mut never_sent = session.player.usual();
    never_sent.points_header = None;
    // The frame with a later scan comes first, so that ingest has sent a later scan when the frame without points comes.
    for mut frame in [of_another, never_sent] {
        let answer = session.ask(&mut frame)?;
        for flag in [Flags::POINTS_GONE, Flags::DEGRADED] {
            let name: String = flag.names().collect();
            ensure!(is_flagged(&answer, &[flag]), "not flagged {name}");
        }
    }
    Ok("2 frames answered and flagged".to_string())
}

pub(super) fn sent_again(session: &mut Session) -> Outcome {
    let mut frame = session.player.usual();
    let first = session.ask(&mut frame)?;
    for header in std::iter::once(&mut frame.header).chain(&mut frame.points_header) {
        header.attempt = 1;
        header.flags |= Flags::RESENT.0;
    }
    let second = session.ask(&mut frame)?;
    let is_same = first.objects == second.objects;
    let which = if is_same { "the same" } else { "OTHER" };
    Ok(format!("both answered; the frame gave {which} objects"))
}
