//! Frames as they may come from sound stages.

use anyhow::{Context, ensure};
use mluc_ipc_types::{CandidateCounts, DETECTIONS_MAX, Detection, Flags, POINTS_MAX, Point};

use super::Outcome;
use crate::refiner::answer::{check_form, check_objects, is_flagged};
use crate::refiner::frame::Answer;
use crate::refiner::scene::{CAR, CART, Thing, blob, candidate, known, scan, usual};
use crate::refiner::session::Session;

pub(super) fn scene(session: &mut Session<'_>) -> Outcome {
    session.ready()?;
    let before = counted(session)?;
    let (points, detections) = usual();
    let frame = session.player.frame(points, detections);
    let (sent, answer) = session.ask(&frame)?;
    let unknown = &answer.objects[1];
    let off_m = (unknown.center_m[0] - CART.x_m).hypot(unknown.center_m[1] - CART.y_m);
    let counts = check_counts(before, &answer, counted(session)?)?;
    Ok(format!(
        "answered in {:.1} ms; the unknown object has {} points and lies {off_m:.2} m off; {counts}",
        answer.took_ms(&sent),
        unknown.points_count
    ))
}

/// What its health says now of the candidates so far.
fn counted(session: &mut Session<'_>) -> anyhow::Result<CandidateCounts> {
    let patience = session.options.patience;
    let heard = session.player.await_health(patience, |_| true)?;
    Ok(heard.context("no heartbeat")?.candidates)
}

/// Whoever counts candidates counts right; zeros are fine.
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

pub(super) fn empty(session: &mut Session<'_>) -> Outcome {
    session.ready()?;
    let (points, detections) = usual();
    for (points, detections) in [
        (vec![], vec![]),
        (points, vec![]),
        (vec![], detections.clone()),
        (usual().0, vec![]),
        (vec![], detections),
    ] {
        let mut frame = session.player.frame(points, detections);
        if frame.points.is_empty() {
            frame.header.flags |= Flags::EMPTY.0;
        }
        let (_, answer) = session.ask(&frame)?;
        ensure!(
            !is_flagged(&answer, &[Flags::POINTS_GONE]),
            "a scan without points is flagged points_gone, although it came"
        );
    }
    Ok("5 frames answered".to_string())
}

/// Slowest answer of frames, ms.
fn slowest(session: &mut Session<'_>, frames: Vec<(Vec<Point>, Vec<Detection>)>) -> Outcome {
    session.ready()?;
    let count = frames.len();
    let mut slowest_ms = 0.0f64;
    for (points, detections) in frames {
        let frame = session.player.frame(points, detections);
        let (sent, answer) = session.ask(&frame)?;
        slowest_ms = slowest_ms.max(answer.took_ms(&sent));
    }
    Ok(format!(
        "{count} frames answered, the slowest in {slowest_ms:.1} ms"
    ))
}

fn spread(number: usize) -> Thing {
    let angle = number as f32 * 2.4;
    let range = 5.0 + number as f32 * 0.09;
    Thing {
        x_m: range * angle.cos(),
        y_m: range * angle.sin(),
        ..CART
    }
}

pub(super) fn candidates(session: &mut Session<'_>) -> Outcome {
    let on_one_spot = (0..DETECTIONS_MAX)
        .map(|number| candidate(&CART, [number as f32 * 0.001, 0.0]))
        .collect();
    let things: Vec<Thing> = (0..DETECTIONS_MAX).map(spread).collect();
    let everywhere = things.iter().map(|thing| candidate(thing, [0.2, 0.1]));
    let all_known = things.iter().map(known).collect();
    slowest(
        session,
        vec![
            (scan(&[CART, CAR], 20_000), on_one_spot),
            (scan(&things, 60_000), everywhere.collect()),
            (scan(&things, 60_000), all_known),
        ],
    )
}

pub(super) fn points(session: &mut Session<'_>) -> Outcome {
    let detections = || -> Vec<Detection> {
        let shifts = (0..20).map(|number| number as f32 * 0.02);
        shifts
            .map(|shift| candidate(&CART, [shift, -shift]))
            .collect()
    };
    slowest(
        session,
        vec![
            (scan(&[CART, CAR], POINTS_MAX), detections()),
            (blob(&CART, POINTS_MAX), detections()),
            (vec![Point::default(); POINTS_MAX], detections()),
        ],
    )
}

pub(super) fn points_gone(session: &mut Session<'_>) -> Outcome {
    session.ready()?;
    let (points, detections) = usual();
    let mut of_another = session.player.frame(points.clone(), detections.clone());
    if let Some(header) = &mut of_another.points_header {
        header.sequence += 1_000_000;
    }
    let mut never_sent = session.player.frame(points, detections);
    never_sent.points_header = None;
    // The later scan first: ingest has sent more than the frame without points.
    for frame in [of_another, never_sent] {
        let mut sent = session.player.send(&frame)?;
        sent.points = 0;
        let answer = session.await_answer(&sent)?;
        check_form(&sent, &answer, session.options.classes.len())?;
        check_objects(&sent, &answer)?;
        for (flag, name) in [
            (Flags::POINTS_GONE, "points_gone"),
            (Flags::DEGRADED, "degraded"),
        ] {
            ensure!(is_flagged(&answer, &[flag]), "not flagged {name}");
        }
    }
    Ok("2 frames answered and flagged".to_string())
}

pub(super) fn sent_again(session: &mut Session<'_>) -> Outcome {
    session.ready()?;
    let (points, detections) = usual();
    let mut frame = session.player.frame(points, detections);
    let (_, first) = session.ask(&frame)?;
    for header in [Some(&mut frame.header), frame.points_header.as_mut()]
        .into_iter()
        .flatten()
    {
        header.attempt = 1;
        header.flags |= Flags::RESENT.0;
    }
    let (_, second) = session.ask(&frame)?;
    let is_same = first.objects == second.objects;
    Ok(format!(
        "both answered; the same frame gave {} objects",
        if is_same { "the same" } else { "OTHER" }
    ))
}
