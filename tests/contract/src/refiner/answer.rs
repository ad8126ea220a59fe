//! Checks whether an answer keeps the contract.

use crate::refiner::player::{Answer, Frame};
use anyhow::{bail, ensure};
use mluc_ipc_types::{DETECTIONS_MAX, Disposition, Flags, FrameHeader, Object, Stage};

/// Checks what holds for every answer, whatever the input was.
pub(crate) fn check_form(frame: &Frame, answer: &Answer, classes: usize) -> anyhow::Result<()> {
    check_header(&frame.header, answer)?;
    let objects = Object::checked(&answer.header, &answer.objects, classes)?;
    let Some((indices_header, indices)) = &answer.indices else {
        bail!("objects came without object_points, which are published first");
    };
    let [of_points, of_objects] = [indices_header, &answer.header].map(|h| (h.run_id, h.sequence));
    ensure!(
        of_points == of_objects,
        "object_points of run and frame {of_points:?} came with the objects of {of_objects:?}"
    );
    Object::checked_points(indices_header, indices, frame.points_found())?;
    Ok(Object::checked_ranges(objects, indices.len())?)
}

type Field = fn(&FrameHeader) -> u64;

/// A refiner must pass on these header fields unchanged.
fn check_header(sent: &FrameHeader, answer: &Answer) -> anyhow::Result<()> {
    let got = &answer.header;
    got.checked()?;
    let fields: [(&str, Field); 9] = [
        ("run", |h| h.run_id),
        ("sequence", |h| h.sequence),
        ("sensor stamp", |h| h.sensor_stamp_ns),
        ("sensor", |h| h.sensor_id.into()),
        ("attempt", |h| h.attempt.into()),
        ("points in", |h| h.points_in.into()),
        ("points dropped", |h| h.points_dropped.into()),
        ("points out of range", |h| h.points_out_of_range.into()),
        ("fingerprint of the model", |h| h.model_fingerprint),
    ];
    for (what, field) in fields {
        let (expected, found) = (field(sent), field(got));
        ensure!(
            expected == found,
            "header: {what} is {found}, the detections' message had {expected}"
        );
    }
    let [sent_ego, got_ego] = [sent, got].map(|header| bytemuck::bytes_of(&header.ego));
    let are_stamps_kept = sent.stages[..3] == got.stages[..3];
    for (is_kept, what) in [
        (sent.name == got.name, "the frame's name is"),
        (sent_ego == got_ego, "the pose of the sensor is"),
        (are_stamps_kept, "stamps of the stages before are"),
    ] {
        ensure!(is_kept, "header: {what} changed");
    }
    let lost = sent.flags & !got.flags;
    ensure!(lost == 0, "header: flags {lost:#x} are lost");
    let own = got.stages[Stage::Refiner as usize];
    let begun_ns = sent.stages[Stage::Head as usize].published_ns;
    let times_ns = [begun_ns, own.received_ns, own.started_ns, own.published_ns];
    let in_order = times_ns.is_sorted() && own.published_ns <= answer.received_ns;
    // If the head never ran on a frame, its stamp means nothing.
    ensure!(
        in_order || begun_ns == u64::MAX,
        "header: the refiner's stamps {own:?} are not in order between {begun_ns} and {} (CLOCK_MONOTONIC, ns)",
        answer.received_ns
    );
    Ok(())
}

/// Checks what holds when all detections make sense: each has its object at its index, and known objects are unchanged.
pub(crate) fn check_objects(frame: &Frame, answer: &Answer) -> anyhow::Result<()> {
    let expected = frame.detections.len().min(DETECTIONS_MAX);
    let found = answer.objects.len();
    ensure!(
        found >= expected,
        "{found} objects for {expected} detections: each has one, suppressed ones too"
    );
    for (index, (detection, object)) in frame.detections.iter().zip(&answer.objects).enumerate() {
        // A candidate becomes an unknown object; both have the same number.
        let pairs =
            [("kind", detection.kind, object.kind), ("class", detection.class_id, object.class_id)];
        for (what, expected, found) in pairs {
            ensure!(
                expected == found,
                "object {index} has {what} {found}, its detection {expected}"
            );
        }
        ensure!(
            object.disposition != Disposition::InvalidBox as u32,
            "object {index}: its detection's box is sound and called invalid"
        );
        let is_same = object.center_m == detection.center_m
            && object.size_m == detection.size_m
            && object.yaw_rad == detection.yaw_rad
            && object.score == detection.score;
        ensure!(
            detection.is_candidate() || is_same && object.is_published(),
            "object {index} is known: its box and score pass unchanged and published"
        );
    }
    Ok(())
}

pub(crate) fn is_flagged(answer: &Answer, flags: &[Flags]) -> bool {
    let of_answer = Flags(answer.header.flags);
    flags.iter().any(|&flag| of_answer.contains(flag))
}
