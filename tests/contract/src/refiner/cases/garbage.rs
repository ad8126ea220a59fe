//! What no sound stage sends.

use anyhow::{Context, ensure};
use mluc_ipc_types::{
    DETECTIONS_MAX, Detection, Disposition, Flags, NAME_MAX, Object, POINTS_MAX, Point,
};

use super::Outcome;
use crate::refiner::answer::{check_form, is_flagged};
use crate::refiner::frame::{Answer, Frame};
use crate::refiner::scene::{CART, Noise, candidate, scan, usual};
use crate::refiner::session::{Reaction, Session};

/// Frames of noise.
const NOISY_FRAMES: u64 = 8;

/// Provokes, and sees that a sound frame is answered afterwards. True: it was refused.
fn survive(
    session: &mut Session<'_>,
    what: &str,
    frame: &Frame,
    is_told: impl Fn(&Answer) -> bool,
) -> anyhow::Result<bool> {
    let reaction = session.provoke(frame).with_context(|| what.to_string())?;
    if let Reaction::Answered(pair) = &reaction {
        let (sent, answer) = pair.as_ref();
        check_form(sent, answer, session.options.classes.len())
            .with_context(|| what.to_string())?;
        ensure!(
            is_told(answer),
            "{what}: answered as if nothing were wrong (flags {:#x}), neither flagged nor refused",
            answer.header.flags
        );
    }
    let (points, detections) = usual();
    let sound = session.player.frame(points, detections);
    session
        .ask(&sound)
        .with_context(|| format!("the sound frame after: {what}"))?;
    Ok(matches!(reaction, Reaction::Refused(_)))
}

fn summary(count: usize, refused: usize) -> String {
    format!(
        "{count} survived: {refused} refused, {} answered and flagged",
        count - refused
    )
}

pub(super) fn lengths(session: &mut Session<'_>) -> Outcome {
    session.ready()?;
    let too_many = vec![candidate(&CART, [0.1, 0.1]); DETECTIONS_MAX + 88];
    let (points, detections) = usual();
    let many = session.player.frame(points, too_many);
    let long = session
        .player
        .frame(scan(&[CART], POINTS_MAX + 1000), detections);
    let is_told = |answer: &Answer| {
        is_flagged(
            answer,
            &[Flags::LIMIT_HIT, Flags::DEGRADED, Flags::TRUNCATED],
        )
    };
    let mut refused = 0;
    for (what, frame) in [("600 detections", many), ("263,144 points", long)] {
        refused += usize::from(survive(session, what, &frame, is_told)?);
    }
    Ok(summary(2, refused))
}

/// Spoils a detection.
type Spoil = fn(&mut Detection);

const SPOILS: [(&str, Spoil); 14] = [
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
    ("normalised EDS infinite", |d| {
        d.eds_normalised = f32::INFINITY;
    }),
    ("threshold NaN", |d| d.threshold = f32::NAN),
];

pub(super) fn numbers(session: &mut Session<'_>) -> Outcome {
    session.ready()?;
    let (mut count, mut refused) = (0, 0);
    for (what, spoil) in SPOILS {
        for which in [0, 1] {
            let (points, mut detections) = usual();
            spoil(&mut detections[which]);
            let frame = session.player.frame(points, detections);
            let is_told = |answer: &Answer| is_told_of(answer, which);
            let name = ["of a known box", "of a candidate"][which];
            refused += usize::from(survive(
                session,
                &format!("{what} {name}"),
                &frame,
                is_told,
            )?);
            count += 1;
        }
    }
    let (mut points, detections) = usual();
    for (number, point) in points.iter_mut().enumerate().step_by(3) {
        let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX][number % 4];
        match number % 5 {
            0 => point.x_m = bad,
            1 => point.y_m = bad,
            2 => point.z_m = bad,
            3 => point.intensity = bad,
            _ => {
                *point = Point {
                    x_m: bad,
                    y_m: bad,
                    z_m: bad,
                    intensity: bad,
                }
            }
        }
    }
    let frame = session.player.frame(points, detections);
    let flags = [Flags::NOT_FINITE, Flags::DEGRADED];
    let is_told = |answer: &Answer| is_flagged(answer, &flags);
    refused += usize::from(survive(
        session,
        "points that are not finite",
        &frame,
        is_told,
    )?);
    let frame = noisy_header(session);
    refused += usize::from(survive(session, "a header of noise", &frame, |_| true)?);
    Ok(summary(count + 2, refused))
}

fn is_told_of(answer: &Answer, which: usize) -> bool {
    let told = answer.objects.get(which);
    is_flagged(answer, &[Flags::DEGRADED])
        || told.is_some_and(|object: &Object| object.disposition == Disposition::InvalidBox as u32)
}

/// Everything but version, sequence and model is nonsense: it is passed on as it came.
fn noisy_header(session: &mut Session<'_>) -> Frame {
    let (points, detections) = usual();
    let mut frame = session.player.frame(points, detections);
    let header = &mut frame.header;
    header.flags = u32::MAX;
    (header.points_in, header.points_dropped) = (u32::MAX, u32::MAX);
    (header.feature_rows, header.feature_channels) = (u32::MAX, u32::MAX);
    header.sensor_stamp_ns = u64::MAX;
    header.limit_dropped = u32::MAX;
    header.ego.position_m = [f64::NAN; 3];
    header.ego.is_known = 77;
    header.name = [0xff; NAME_MAX];
    frame
}

pub(super) fn noise(session: &mut Session<'_>) -> Outcome {
    session.ready()?;
    let mut refused = 0;
    for seed in 1..=NOISY_FRAMES {
        let mut noise = Noise(seed * 0x9e37_79b9_7f4a_7c15);
        let (mut points, mut detections) = usual();
        detections.resize(64, detections[1]);
        let mut frame = session.player.frame(Vec::new(), Vec::new());
        match seed % 3 {
            0 => points.iter_mut().for_each(|point| noise.fill(point)),
            1 => detections.iter_mut().for_each(|d| noise.fill(d)),
            _ => {
                points.iter_mut().for_each(|point| noise.fill(point));
                detections.iter_mut().for_each(|d| noise.fill(d));
            }
        }
        (frame.points, frame.detections) = (points, detections);
        let what = format!("noise of seed {seed}");
        refused += usize::from(survive(session, &what, &frame, |_| true)?);
    }
    Ok(summary(NOISY_FRAMES as usize, refused))
}
