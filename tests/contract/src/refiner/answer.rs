//! Whether an answer keeps the contract.

use anyhow::{bail, ensure};
use mluc_ipc_types::{
    DETECTIONS_MAX, Detection, DetectionKind, Disposition, Flags, FrameHeader, Object, ObjectKind,
    Stage,
};

use crate::refiner::frame::{Answer, Sent};

/// What holds of every answer, whatever came in.
pub(crate) fn check_form(sent: &Sent, answer: &Answer, classes: usize) -> anyhow::Result<()> {
    check_header(&sent.header, answer)?;
    let objects = Object::checked(&answer.header, &answer.objects, classes)?;
    let Some((indices_header, indices)) = &answer.indices else {
        bail!("objects came without object_points, which are published first");
    };
    ensure!(
        indices_header.sequence == answer.header.sequence,
        "object_points of frame {} came with the objects of frame {}",
        indices_header.sequence,
        answer.header.sequence
    );
    Object::checked_points(indices_header, indices, sent.points)?;
    Object::checked_ranges(objects, indices.len())?;
    Ok(())
}

/// Everything that a refiner passes on is as it came.
fn check_header(sent: &FrameHeader, answer: &Answer) -> anyhow::Result<()> {
    let got = &answer.header;
    got.checked()?;
    let pairs = [
        ("run", sent.run_id, got.run_id),
        ("sequence", sent.sequence, got.sequence),
        ("sensor stamp", sent.sensor_stamp_ns, got.sensor_stamp_ns),
        ("sensor", sent.sensor_id.into(), got.sensor_id.into()),
        ("attempt", sent.attempt.into(), got.attempt.into()),
        ("points in", sent.points_in.into(), got.points_in.into()),
        (
            "points dropped",
            sent.points_dropped.into(),
            got.points_dropped.into(),
        ),
        (
            "points out of range",
            sent.points_out_of_range.into(),
            got.points_out_of_range.into(),
        ),
        (
            "fingerprint of the model",
            sent.model_fingerprint,
            got.model_fingerprint,
        ),
    ];
    for (what, expected, found) in pairs {
        ensure!(
            expected == found,
            "header: {what} is {found}, the detections' message had {expected}"
        );
    }
    ensure!(sent.name == got.name, "header: the frame's name is changed");
    ensure!(
        bytemuck::bytes_of(&sent.ego) == bytemuck::bytes_of(&got.ego),
        "header: the pose of the sensor is changed"
    );
    ensure!(
        got.flags & sent.flags == sent.flags,
        "header: flags {:#x} are lost",
        sent.flags & !got.flags
    );
    ensure!(
        sent.stages[..3] == got.stages[..3],
        "header: stamps of the stages before are changed"
    );
    let own = got.stages[Stage::Refiner as usize];
    let begun_ns = sent.stages[Stage::Head as usize].published_ns;
    let in_order = begun_ns <= own.received_ns
        && own.received_ns <= own.started_ns
        && own.started_ns <= own.published_ns
        && own.published_ns <= answer.received_ns;
    // A frame whose head never ran has a stamp that means nothing.
    ensure!(
        in_order || begun_ns == u64::MAX,
        "header: the refiner's stamps {own:?} are not in order between {begun_ns} and {} (CLOCK_MONOTONIC, ns)",
        answer.received_ns
    );
    Ok(())
}

/// What holds when all detections make sense: each has its object in its place, known ones unchanged.
pub(crate) fn check_objects(sent: &Sent, answer: &Answer) -> anyhow::Result<()> {
    let expected = sent.detections.len().min(DETECTIONS_MAX);
    ensure!(
        answer.objects.len() >= expected,
        "{} objects for {expected} detections: each has one, suppressed ones too",
        answer.objects.len()
    );
    for (index, (detection, object)) in sent.detections.iter().zip(&answer.objects).enumerate() {
        let kind = if detection.is_candidate() {
            ObjectKind::Unknown
        } else {
            ObjectKind::Known
        };
        ensure!(
            object.kind == kind as u32,
            "object {index} has kind {}, its detection is of kind {}",
            object.kind,
            detection.kind
        );
        ensure!(
            object.disposition != Disposition::InvalidBox as u32,
            "object {index}: its detection's box is sound and called invalid"
        );
        ensure!(
            object.class_id == detection.class_id,
            "object {index} has class {}, its detection {}",
            object.class_id,
            detection.class_id
        );
        if detection.kind == DetectionKind::Known as u32 {
            check_known(index, detection, object)?;
        }
    }
    Ok(())
}

fn check_known(index: usize, detection: &Detection, object: &Object) -> anyhow::Result<()> {
    let is_same = object.center_m == detection.center_m
        && object.size_m == detection.size_m
        && object.yaw_rad == detection.yaw_rad
        && object.score == detection.score;
    ensure!(
        is_same && object.is_published(),
        "object {index} is known: its box and score pass unchanged and published"
    );
    Ok(())
}

/// Whether one of `flags` is set.
pub(crate) fn is_flagged(answer: &Answer, flags: &[Flags]) -> bool {
    flags
        .iter()
        .any(|&flag| Flags(answer.header.flags).contains(flag))
}
