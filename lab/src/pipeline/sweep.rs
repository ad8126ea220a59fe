//! Open-set figures at many thresholds of the gate.

use super::stages::class_names;
use super::{DetectedFrame, FoundObject, FrameSet, Gate, ObjectFinder, PipelineError};
use crate::evaluate::{ClassRule, SweepPoint, TruthFrame, best_point, quantile_grid, sweep};
use mluc_head::Detection;
use mluc_model::Model;
use mluc_refiner::Settings;
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

/// Thresholds tried beside the closed set.
pub const THRESHOLDS: usize = 60;

/// The figures of the closed set, then those of a grid of thresholds, ascending.
#[derive(Clone, Debug)]
pub struct GateSweep {
    /// Thresholds as [`Gate`] has them; the first is 0, the closed set.
    pub points: Vec<SweepPoint>,
    /// The best harmonic mean among those that keep nine tenths of the closed set's mAP (paper section 4.3).
    pub best: Option<SweepPoint>,
}

impl GateSweep {
    fn of(points: Vec<SweepPoint>) -> GateSweep {
        let closed = points.first().map_or(0.0, |point| point.map_known);
        GateSweep {
            best: best_point(&points, closed),
            points,
        }
    }
}

/// Refines every frame at every threshold (`step` is called after each frame) and judges each. The thresholds cut what
/// [`Gate`] looks at, over all kept boxes, into [`THRESHOLDS`] equal parts.
pub fn sweep_gate(
    model: &Model,
    set: &FrameSet,
    frames: &[DetectedFrame],
    rules: &[ClassRule],
    settings: &Settings,
    step: impl Fn() + Sync,
) -> Result<GateSweep, PipelineError> {
    let thresholds = thresholds(Gate::of(model), frames);
    let cache = objects_at(model, set, frames, settings, &thresholds, step)?;
    let classes = class_names(model);
    let truths: Vec<TruthFrame> = frames.iter().map(|frame| frame.truth.clone()).collect();
    let asked: Vec<f64> = thresholds.iter().map(|t| f64::from(*t)).collect();
    let points = sweep(&truths, rules, &asked, |frame, threshold| {
        let at = asked.iter().position(|t| *t == threshold).unwrap_or(0);
        let objects = cache[frame][at].iter();
        objects.map(|o| o.to_detection(&classes)).collect()
    });
    Ok(GateSweep::of(points))
}

/// 0, which no box is below, then the grid.
fn thresholds(gate: Gate, frames: &[DetectedFrame]) -> Vec<f32> {
    let boxes = frames.iter().flat_map(|frame| &frame.detections);
    let values = boxes.map(|d| gate.value(d)).filter(|v| gate.may_be(*v));
    let scores: Vec<f64> = values.map(f64::from).collect();
    let grid = quantile_grid(&scores, THRESHOLDS);
    // The grid's values are boxes' own f32 values: they go back without loss.
    [0.0]
        .into_iter()
        .chain(grid.into_iter().map(|t| t as f32))
        .collect()
}

/// Published objects by frame, then by threshold; thresholds ascend. Frames go in parallel; the result does not depend
/// on the number of threads.
pub(crate) fn objects_at(
    model: &Model,
    set: &FrameSet,
    frames: &[DetectedFrame],
    settings: &Settings,
    thresholds: &[f32],
    step: impl Fn() + Sync,
) -> Result<Vec<Vec<Vec<FoundObject>>>, PipelineError> {
    let gate = Gate::of(model);
    // One refiner a thread at a time: its buffers are large, so they go from frame to frame.
    let spare = Mutex::new(vec![ObjectFinder::new(model, settings)?]);
    let take = || spare.lock().unwrap_or_else(PoisonError::into_inner).pop();
    let one_frame = |(index, frame): (usize, &DetectedFrame)| {
        let mut finder = match take() {
            Some(finder) => finder,
            None => ObjectFinder::new(model, settings)?,
        };
        let points = set.points(index)?;
        let mut found: Vec<Vec<FoundObject>> = Vec::with_capacity(thresholds.len());
        let mut before = None;
        for &threshold in thresholds {
            let boxes = frame.detections.iter();
            let fires = |d: &&Detection| gate.apply(d, true, threshold).is_some();
            let candidates = boxes.filter(fires).count();
            // Thresholds ascend: as many candidates are the same candidates.
            let objects = match (before, found.last()) {
                (Some(count), Some(last)) if count == candidates => last.clone(),
                _ => {
                    let boxes = (&frame.detections[..], frame.generic);
                    finder.objects(index as u64, &points, boxes, threshold)
                }
            };
            before = Some(candidates);
            found.push(objects);
        }
        spare
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .push(finder);
        step();
        Ok(found)
    };
    frames.par_iter().enumerate().map(one_frame).collect()
}
