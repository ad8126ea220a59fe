//! The parts of a consumer's contract, one function each.

use super::{Session, Suite, player::Frame, player::Player};
use crate::suite::{Case, Outcome, fill, wrong_instance};
use anyhow::{Context, ensure};
use mluc_geometry::Random;
use mluc_ipc_types::Stage;
use mluc_runtime::ClaimNote;
use rustix::process::Signal;
use serde_json::Value;
use std::time::{Duration, Instant};

const FRAMES: usize = 5;
/// Frames that are sent while the program is held.
const HELD: usize = 100;
/// A topic's queue, and one frame in progress.
const TAKEN_MAX: usize = 3;
/// Limit for handing over one frame; it usually takes some us.
const SEND_MAX: Duration = Duration::from_millis(500);
/// Time for which a hostile frame stays the newest.
const TAKEN: Duration = Duration::from_millis(100);
const SILENCE: Duration = Duration::from_millis(2500);
const KILLS: usize = 5;

pub(super) const CASES: &[Case<Session>] = &[
    ("start", start),
    ("frames", frames),
    ("overload", overload),
    ("hostile_headers", hostile_headers),
    ("hostile_values", hostile_values),
    ("silence", silence),
    ("new_run", new_run),
    ("new_pipeline", new_pipeline),
    ("places", places),
    ("wrong_version", |s| wrong_instance(&s.tested.options)),
    ("stop", |s| s.tested.terminate()),
];

fn start(session: &mut Session) -> Outcome {
    let begun = Instant::now();
    Suite::ready(session)?;
    let took = begun.elapsed();
    let places = session.player()?.consumers();
    ensure!(
        places.iter().all(|count| *count <= 1),
        "places on points, objects and object_points: expected at most 1 each, found {places:?}"
    );
    for stage in Stage::ALL.map(Stage::name) {
        let taken = ClaimNote::of_living(&session.tested.instance, stage);
        ensure!(taken.is_none(), "it holds the place of the stage {stage}");
    }
    Ok(format!("first frame after {:.1} s", took.as_secs_f64()))
}

fn frames(session: &mut Session) -> Outcome {
    for _ in 0..FRAMES {
        session.ask()?;
    }
    // A later scan has come; the scan of this frame never came.
    let player = session.player()?;
    let mut gone = player.frame();
    let points = gone.points.take().unwrap_or_default();
    player.next += 1;
    player.send_scan(&points)?;
    player.send(&gone)?;
    session.await_line(&gone).context("a frame without its points")?;
    session.ask()?;
    Ok(format!("{FRAMES} taken, and one without its points"))
}

fn overload(session: &mut Session) -> Outcome {
    session.ask()?;
    let before = session.lines()?.len();
    session.tested.program()?.signal(Signal::STOP);
    std::thread::sleep(Duration::from_millis(50));
    let mut slowest = Duration::ZERO;
    let mut newest = session.player()?.frame();
    for _ in 0..HELD {
        newest = session.player()?.frame();
        let begun = Instant::now();
        session.player()?.send(&newest)?;
        slowest = slowest.max(begun.elapsed());
    }
    session.tested.program()?.signal(Signal::CONT);
    session.await_line(&newest)?;
    let taken = session.lines()?.len() - before;
    ensure!(
        taken <= TAKEN_MAX,
        "held while {HELD} frames came: expected at most {TAKEN_MAX} of them, it took {taken}"
    );
    ensure!(slowest < SEND_MAX, "the pipeline waited {slowest:?} for it");
    session.ask()?;
    Ok(format!("{taken} of {HELD} taken, the newest too; handing over took {slowest:?} at most"))
}

/// Sends a frame, then a sound one, which must be taken; returns the line of the first frame.
fn line_of(session: &mut Session, what: &str, frame: &Frame) -> anyhow::Result<Option<Value>> {
    let (sequence, before) = (frame.header.sequence, session.lines()?.len());
    session.player()?.send(frame)?;
    std::thread::sleep(TAKEN);
    // Each line is read as JSON, which has no NaN.
    session.ask().with_context(|| format!("the sound frame after: {what}"))?;
    let mut lines = session.lines()?.into_iter().skip(before);
    Ok(lines.find(|line| line["sequence"] == sequence))
}

type Spoil = fn(&mut Frame);

fn hostile_headers(session: &mut Session) -> Outcome {
    let spoils: [(&str, Spoil); 6] = [
        ("another wire version", |f| f.header.wire_version += 41),
        ("another run", |f| f.header.run_id ^= 1),
        ("another model", |f| f.header.model_fingerprint ^= 1),
        ("sequence 2^64-1", |f| f.header.sequence = u64::MAX),
        ("a sequence far ahead", |f| f.header.sequence += 1_000_000),
        ("a sequence that goes back", |f| f.header.sequence -= 2),
    ];
    for _ in 0..3 {
        session.ask()?;
    }
    for (what, spoil) in spoils {
        let mut frame = session.player()?.frame();
        spoil(&mut frame);
        let line = line_of(session, what, &frame)?;
        ensure!(line.is_none(), "{what}: it was used");
    }
    let count = spoils.len();
    Ok(format!("{count} not used, the sound frame after each was taken"))
}

/// Whether a line passes on spoiled data: all published objects although one was spoiled, or points although the indices were spoiled.
fn passes_on(line: &Value, sound: &Frame, spoiled: &Frame) -> bool {
    let objects = || line["objects"].as_array().into_iter().flatten();
    let mut pairs = sound.objects.iter().zip(&spoiled.objects);
    let is_object_spoiled = sound.objects.len() != spoiled.objects.len()
        || pairs.any(|(sound, spoiled)| sound.is_published() && sound != spoiled);
    let are_all_there = objects().count() >= sound.published_points().len();
    let has_points = objects().any(|object| object["points"].as_u64() > Some(0));
    is_object_spoiled && are_all_there || sound.indices != spoiled.indices && has_points
}

fn hostile_values(session: &mut Session) -> Outcome {
    let spoils: [(&str, Spoil); 15] = [
        ("600 objects", |f| f.objects.resize(600, f.objects[0])),
        ("centre NaN", |f| f.objects[0].center_m[0] = f32::NAN),
        ("class 4294967295", |f| f.objects[0].class_id = u32::MAX),
        ("kind 7", |f| f.objects[0].kind = 7),
        ("disposition 99", |f| f.objects[0].disposition = 99),
        ("size infinite", |f| f.objects[2].size_m[1] = f32::INFINITY),
        ("score NaN", |f| f.objects[2].score = f32::NAN),
        ("gate 7", |f| f.objects[0].gate = 7),
        ("P(unknown) 7", |f| f.objects[2].unknown_probability = 7.0),
        ("4e9 corners", |f| f.objects[0].footprint_count = u32::MAX),
        ("outline clockwise", |f| f.objects[0].footprint_m.swap(0, 1)),
        ("suppressor 2^31", |f| f.objects[1].suppressed_by = 1 << 31),
        ("2^31 points", |f| f.objects[2].points_count = 1 << 31),
        ("indices 2^32-2", |f| f.indices.fill(u32::MAX - 1)),
        ("noise", |f| {
            let mut random = Random::new(7, &[]);
            fill(&mut random, &mut f.objects);
            fill(&mut random, &mut f.indices);
        }),
    ];
    for (what, spoil) in spoils {
        let player = session.player()?;
        let (sound, mut frame) = (player.frame(), player.frame());
        spoil(&mut frame);
        let line = line_of(session, what, &frame)?.unwrap_or_default();
        let is_passed_on = passes_on(&line, &sound, &frame);
        ensure!(!is_passed_on, "{what}: passed on in the line {line}");
    }
    Ok(format!("{} survived", spoils.len()))
}

/// Checks that the program stays alive while no frame comes.
fn stays(session: &mut Session, time: Duration) -> anyhow::Result<()> {
    std::thread::sleep(time);
    session.tested.check_alive("frames")
}

fn silence(session: &mut Session) -> Outcome {
    session.ask()?;
    stays(session, SILENCE)?;
    session.ask()?;
    Ok(format!("stayed for {SILENCE:?}, and took the next frame"))
}

fn new_run(session: &mut Session) -> Outcome {
    session.ask()?;
    let mut old = session.player()?.frame();
    session.player()?.begin_run()?;
    session.ask().context("frame 0 of a new run")?;
    // Its sequence was also sent in this run.
    (old.header.sequence, old.points) = (1, None);
    let player = session.player()?;
    let points = player.frame().points.unwrap_or_default();
    player.send_scan(&points)?;
    let line = line_of(session, "a frame of the run before", &old)?;
    ensure!(line.is_none(), "a frame of the run before: it was used");
    Ok("joined from frame 0; the run before is over".to_string())
}

fn new_pipeline(session: &mut Session) -> Outcome {
    session.ask()?;
    session.player = None;
    let stayed = stays(session, Duration::from_secs(1));
    let tested = &session.tested;
    session.player = Some(Player::new(&tested.instance, &tested.options)?);
    stayed?;
    let begun = Instant::now();
    session.first_frame()?;
    let took = begun.elapsed();
    Ok(format!("took a frame of the next one after {took:?}"))
}

fn places(session: &mut Session) -> Outcome {
    for kill in 1..=KILLS {
        session.tested.stop();
        Suite::ready(session).with_context(|| format!("after kill -9 number {kill}"))?;
    }
    Ok(format!("killed {KILLS} times, back each time"))
}
