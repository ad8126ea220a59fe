//! Frames that no sound stage sends.

use super::Outcome;
use crate::refiner::player::{Answer, Frame};
use crate::refiner::scene::{CART, candidate, scan};
use crate::{refiner::answer::is_flagged, refiner::session::Session, suite::fill};
use anyhow::{Context, ensure};
use mluc_geometry::Random;
use mluc_ipc_types::{DETECTIONS_MAX, Detection, Disposition, Flags, NAME_MAX, Object, POINTS_MAX};

const NOISY_FRAMES: u64 = 8;

/// Sends a bad frame and checks that a sound frame is answered afterwards; returns whether the bad frame itself was answered.
fn survives(
    session: &mut Session,
    what: &str,
    mut frame: Frame,
    is_told: impl Fn(&Answer) -> bool,
) -> anyhow::Result<bool> {
    let reaction = session.provoke(what, &mut frame)?;
    if let Ok(answer) = &reaction {
        session.check_form(&frame, answer).with_context(|| what.to_string())?;
        ensure!(
            is_told(answer),
            "{what}: answered as if nothing were wrong (flags {:#x}), neither flagged nor refused",
            answer.header.flags
        );
    }
    session.ask_after(what)?;
    Ok(reaction.is_ok())
}

/// Counts which of the frames that the program survived were answered.
fn summary(was_answered: &[bool]) -> Outcome {
    let count = was_answered.len();
    let answered = was_answered.iter().filter(|is| **is).count();
    let refused = count - answered;
    Ok(format!("{count} survived: {refused} refused, {answered} answered and flagged"))
}

pub(super) fn lengths(session: &mut Session) -> Outcome {
    let mut answered = Vec::new();
    let mut many = session.player.usual();
    many.detections = vec![candidate(&CART, [0.1, 0.1]); DETECTIONS_MAX + 88];
    let mut long = session.player.usual();
    long.points = scan(&[CART], POINTS_MAX + 1000);
    let flags = [Flags::LIMIT_HIT, Flags::DEGRADED, Flags::TRUNCATED];
    for (what, frame) in [("600 detections", many), ("263,144 points", long)] {
        let is_told = |answer: &Answer| is_flagged(answer, &flags);
        answered.push(survives(session, what, frame, is_told)?);
    }
    summary(&answered)
}

type Spoil = fn(&mut Detection);

const SPOILS: [(&str, Spoil); 16] = [
    ("class 4294967295", |d| d.class_id = u32::MAX),
    ("class 8", |d| d.class_id = 8),
    ("kind 7", |d| d.kind = 7),
    ("centre NaN", |d| d.center_m[0] = f32::NAN),
    ("centre infinite", |d| d.center_m[1] = f32::INFINITY),
    ("size NaN", |d| d.size_m[2] = f32::NAN),
    ("size zero", |d| d.size_m[0] = 0.0),
    ("size negative", |d| d.size_m[1] = -2.0),
    ("size infinite", |d| d.size_m[0] = f32::INFINITY),
    ("yaw NaN", |d| d.yaw_rad = f32::NAN),
    ("score NaN", |d| d.score = f32::NAN),
    ("EDS NaN", |d| d.eds = f32::NAN),
    ("eds_normalised inf", |d| d.eds_normalised = f32::INFINITY),
    ("P(unknown) 7", |d| d.unknown_probability = 7.0),
    ("gate 7", |d| d.gate = 7),
    ("threshold NaN", |d| d.threshold = f32::NAN),
];

pub(super) fn numbers(session: &mut Session) -> Outcome {
    let mut answered = Vec::new();
    for (what, spoil) in SPOILS {
        for (which, name) in ["of a known box", "of a candidate"].into_iter().enumerate() {
            let mut frame = session.player.usual();
            spoil(&mut frame.detections[which]);
            let what = format!("{what} {name}");
            let is_invalid = |o: &Object| o.disposition == Disposition::InvalidBox as u32;
            answered.push(survives(session, &what, frame, |answer| {
                is_flagged(answer, &[Flags::DEGRADED])
                    || answer.objects.get(which).is_some_and(is_invalid)
            })?);
        }
    }
    let mut frame = session.player.usual();
    for (number, point) in frame.points.iter_mut().enumerate().step_by(3) {
        let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX][number % 4];
        let coordinates: &mut [f32; 4] = bytemuck::cast_mut(point);
        match coordinates.get_mut(number % 5) {
            Some(coordinate) => *coordinate = bad,
            None => *coordinates = [bad; 4],
        }
    }
    let flags = [Flags::NOT_FINITE, Flags::DEGRADED];
    let is_told = |answer: &Answer| is_flagged(answer, &flags);
    let what = "points that are not finite";
    answered.push(survives(session, what, frame, is_told)?);
    let mut frame = session.player.usual();
    spoil_header(&mut frame);
    answered.push(survives(session, "a header of noise", frame, |_| true)?);
    summary(&answered)
}

/// Everything but version, run, sequence and model is nonsense and must be passed on unchanged.
fn spoil_header(frame: &mut Frame) {
    let header = &mut frame.header;
    header.flags = u32::MAX;
    (header.points_in, header.points_dropped) = (u32::MAX, u32::MAX);
    (header.feature_rows, header.feature_channels) = (u32::MAX, u32::MAX);
    header.sensor_stamp_ns = u64::MAX;
    header.limit_dropped = u32::MAX;
    header.ego.position_m = [f64::NAN; 3];
    header.ego.is_known = 77;
    header.name = [0xff; NAME_MAX];
}

pub(super) fn noise(session: &mut Session) -> Outcome {
    let mut answered = Vec::new();
    for seed in 1..=NOISY_FRAMES {
        let mut random = Random::new(seed, &[]);
        let mut frame = session.player.usual();
        let second = frame.detections[1];
        frame.detections.resize(64, second);
        if seed % 3 != 1 {
            fill(&mut random, &mut frame.points);
        }
        if seed % 3 != 0 {
            fill(&mut random, &mut frame.detections);
        }
        let what = format!("noise of seed {seed}");
        answered.push(survives(session, &what, frame, |_| true)?);
    }
    summary(&answered)
}
