//! Detections and the points of the same frame to objects (paper section 3.3).

use mluc_ipc_types::{
    Detection, Flags, HealthState, OBJECT_POINTS_MAX, OBJECTS_MAX, Object, Point, Stage, Topic,
};
use mluc_model::Model;
use mluc_refiner::{Refined, Refiner, Tracker};
use mluc_runtime::{Scans, Shell, monotonic_ns};

use super::frame::{begin, check_model, finish, refuse, stamp_published};
use super::instruments::{frame_span, run_span};
use crate::settings::Settings;

pub(crate) fn run(mut shell: Shell, settings: &Settings, model: &Model) -> anyhow::Result<()> {
    let mut refiner = Refiner::for_model(settings.refiner.clone(), model)?;
    let mut tracker = settings.track.map(Tracker::new).transpose()?;
    let time_max_ns = (settings.refiner.time_max_ms * 1e6) as u64;
    let mut refined = Refined::default();
    let mut objects_out = shell.output::<Object>(&Topic::OBJECTS, OBJECTS_MAX)?;
    let mut points_out = shell.output::<u32>(&Topic::OBJECT_POINTS, OBJECT_POINTS_MAX)?;
    let mut scans = Scans::new(shell.side_input::<Point>(&Topic::POINTS)?);
    let mut input = shell.input::<Detection>(&Topic::DETECTIONS)?;
    shell.state(HealthState::WaitingInput, "waiting for detections")?;
    while let Some(message) = shell.next(&mut input, &Topic::DETECTIONS, || scans.take())? {
        let mut header = begin(Stage::Refiner, message.header(), message.received_ns);
        let _frame = frame_span(&header);
        // A detection that makes no sense is one object's fate (`invalid_box`), not the frame's.
        let checked = Detection::counted(&header, message.elements());
        let detections =
            match checked.and_then(|d| check_model(&header, model.fingerprint).map(|()| d)) {
                Ok(detections) => detections,
                Err(error) => {
                    refuse(&mut shell, &error.to_string())?;
                    continue;
                }
            };
        scans.take()?;
        let scan = scans.of(header.sequence);
        let points = match scan.map(|scan| Point::checked(scan.header(), scan.elements())) {
            Some(Ok(points)) => points,
            _ => {
                header.flag(Flags::POINTS_GONE.with(Flags::DEGRADED));
                &[]
            }
        };
        // Without its points a frame's unknown objects keep their proposals; where nothing waits for the sensor, time
        // has no say and the same scans give the same objects.
        let points_gone = Flags(header.flags).contains(Flags::POINTS_GONE);
        let time_max_ns = settings.budget_ms.map(|_| time_max_ns);
        let start_ns = monotonic_ns();
        let mut is_over =
            || points_gone || time_max_ns.is_some_and(|max| monotonic_ns() - start_ns > max);
        let sequence = header.sequence;
        run_span(|| {
            refiner.refine_within(sequence, points, detections, &mut is_over, &mut refined)
        });
        if let Some(tracker) = &mut tracker {
            tracker.update(header.sequence, &header.ego, &mut refined);
        }
        let counters = &refined.counters;
        header.limit_dropped = header
            .limit_dropped
            .saturating_add(counters.detections_dropped);
        if counters.points_not_finite > 0 {
            header.flag(Flags::NOT_FINITE);
        }
        if counters.limit_hit() {
            header.flag(Flags::LIMIT_HIT);
        }
        if counters.degraded() {
            header.flag(Flags::DEGRADED);
        }
        let latency_ns =
            monotonic_ns().saturating_sub(header.stages[Stage::Ingest as usize].received_ns);
        if settings
            .budget_ms
            .is_some_and(|budget_ms| latency_ns > budget_ms * 1_000_000)
        {
            header.flag(Flags::LATE);
        }
        // First the indices: whoever has the objects can ask for their points.
        let mut draft = points_out.draft(&header, refined.object_points.len())?;
        draft.elements_mut().copy_from_slice(&refined.object_points);
        stamp_published(Stage::Refiner, draft.header_mut());
        draft.publish()?;
        let mut draft = objects_out.draft(&header, refined.objects.len())?;
        draft.elements_mut().copy_from_slice(&refined.objects);
        stamp_published(Stage::Refiner, draft.header_mut());
        draft.publish()?;
        shell.counters.frames_in += 1;
        shell.counters.candidates.add(&refined.objects);
        shell.counters.frames_dropped = input.dropped();
        shell.counters.bytes_read = (size_of_val(points) + size_of_val(detections)) as u64;
        shell.counters.bytes_written =
            (size_of_val(&refined.objects[..]) + size_of_val(&refined.object_points[..])) as u64;
        shell.counters.mappings_verified =
            input.mappings_verified() + scans.input().mappings_verified();
        scans.let_go();
        finish(&mut shell, Stage::Refiner, &header)?;
    }
    Ok(shell.state(HealthState::Stopping, "")?)
}
