//! Detections and the points of the same frame to objects (paper section 3.3).

use super::models::Models;
use crate::settings::{Pace, Settings};
use mluc_ipc_types::{
    Detection, Flags, FrameHeader, OBJECT_POINTS_MAX, OBJECTS_MAX, Object, Point, Stage, Topic,
};
use mluc_model::Model;
use mluc_refiner::{EgoEstimator, Refiner, RefinerOutput, Tracker};
use mluc_runtime::{
    Algorithm, Output, RuntimeError, Shell, StageError, monotonic_ns, run_stage, stamp_published,
};

struct RefinerStage {
    /// Each refiner with run, sequence and number of points of the scan that it has read ahead.
    models: Models<(Refiner, Option<[u64; 3]>)>,
    tracker: Option<(Tracker, EgoEstimator)>,
    refined: RefinerOutput,
    object_points: Output<u32>,
    /// At pace `sensor`: how long a frame may be refined.
    time_max_ns: Option<u64>,
    /// The age from which a frame that leaves is late.
    age_max_ns: Option<u64>,
}

pub(crate) fn run(shell: &mut Shell, settings: &Settings, model: &Model) -> anyhow::Result<()> {
    let time_max_ns = (settings.refiner.time_max_ms * 1e6) as u64;
    let own = settings.refiner.clone();
    let make = move |model: &Model| Ok((Refiner::for_model(own.clone(), model)?, None));
    let tracker = settings.track.map(Tracker::new).transpose()?;
    let stage = RefinerStage {
        models: Models::new(shell, model, make(model)?, make),
        tracker: tracker.map(|tracker| (tracker, EgoEstimator::default())),
        refined: RefinerOutput::default(),
        object_points: shell.output(&Topic::OBJECT_POINTS, OBJECT_POINTS_MAX)?,
        time_max_ns: (settings.pace == Pace::Sensor).then_some(time_max_ns),
        age_max_ns: settings.budget_ms.map(|ms| ms * 1_000_000),
    };
    Ok(run_stage(shell, OBJECTS_MAX, stage)?)
}

impl Algorithm for RefinerStage {
    const STAGE: Stage = Stage::Refiner;
    type Input = Detection;
    type Output = Object;

    fn run(
        &mut self,
        header: &mut FrameHeader,
        elements: &[Detection],
        points: Option<&[Point]>,
    ) -> Result<usize, StageError> {
        let ((refiner, read), thresholds) = self.models.of_frame(header)?;
        if let Some((_, score_min)) = thresholds {
            refiner.set_score_min(score_min);
        }
        // A detection that makes no sense affects one object (disposition `invalid_box`), not the whole frame.
        let detections = Detection::counted(header, elements)?;
        let (points, are_gone) = (points.unwrap_or_default(), points.is_none());
        if are_gone {
            header.flag(Flags::POINTS_GONE.with(Flags::DEGRADED));
        }
        // Without the frame's points its unknown objects keep their proposals. At pace `complete` there is no time limit, so the
        // same scans give the same objects.
        let start_ns = monotonic_ns();
        let has_time = |max_ns| monotonic_ns() - start_ns <= max_ns;
        let mut is_over = || are_gone || !self.time_max_ns.is_none_or(has_time);
        let frame = [header.run_id, header.sequence, points.len() as u64];
        if read.take() != Some(frame) || are_gone {
            refiner.read_scan(points);
        }
        let refined = &mut self.refined;
        refiner.refine_within(header.sequence, points, detections, &mut is_over, refined);
        if let Some((tracker, estimator)) = &mut self.tracker {
            let mut followed = *header;
            let scan = (!are_gone).then(|| refiner.scan());
            followed.ego = estimator.estimate(header, scan).unwrap_or_default();
            tracker.update(&followed, refined);
        }
        refined.choose_readings();
        let counters = &refined.counters;
        header.count_over(Flags::LIMIT_DETECTIONS, counters.detections_dropped);
        header.flag(counters.flags());
        let received_ns = header.stages[Stage::Ingest as usize].received_ns;
        let age_ns = monotonic_ns().saturating_sub(received_ns);
        if self.age_max_ns.is_some_and(|max_ns| age_ns > max_ns) {
            header.flag(Flags::LATE);
        }
        Ok(self.refined.objects.len())
    }

    /// Sorts the scan and finds its ground while the network runs.
    fn read_ahead(&mut self, header: &FrameHeader, points: &[Point]) {
        let (refiner, read) = &mut self.models.made;
        refiner.read_scan(points);
        *read = Some([header.run_id, header.sequence, points.len() as u64]);
    }

    /// The indices go first: a consumer that has the objects can then find their points.
    fn publish_aside(&mut self, header: &FrameHeader) -> Result<usize, RuntimeError> {
        let (mut header, indices) = (*header, &self.refined.object_points[..]);
        stamp_published(Stage::Refiner, &mut header);
        self.object_points.send(&header, indices)?;
        Ok(size_of_val(indices))
    }

    fn write(&mut self, output: &mut [Object]) -> Result<(), StageError> {
        output.copy_from_slice(&self.refined.objects);
        Ok(())
    }

    fn count(&self, shell: &mut Shell) {
        shell.health.candidates.add(&self.refined.objects);
    }
}
