//! Open-set figures at many thresholds of the gate.

use super::stages::{FoundObject, ObjectFinder, class_names};
use super::{DetectedFrame, FrameSet, ModelGate};
use crate::{ClassRule, EvaluateError, FrameTruth, SweepPoint, best_point, quantile_grid, sweep};
use mluc_head::Detection;
use mluc_ipc_types::Point;
use mluc_model::Model;
use mluc_refiner::{RefinerError, Settings};
use rayon::prelude::*;

/// Thresholds tried beside the closed set.
pub const THRESHOLDS: usize = 60;

/// The figures of the closed set, then those of a grid of thresholds, ascending.
#[derive(Clone, Debug)]
pub struct GateSweep {
    /// Thresholds as [`ModelGate`] has them; the first is 0, the closed set.
    pub points: Vec<SweepPoint>,
    /// The best harmonic mean among those that keep nine tenths of the closed set's mAP (paper section 4.3).
    pub best: Option<SweepPoint>,
}

/// Refines every frame at every threshold (`step` is called after each frame) and judges each. The thresholds cut what
/// [`ModelGate`] looks at, over all kept boxes, into [`THRESHOLDS`] equal parts.
pub fn sweep_gate(
    model: &Model,
    set: &FrameSet,
    frames: &[DetectedFrame],
    rules: &[ClassRule],
    settings: &Settings,
    step: &(dyn Fn() + Sync),
) -> Result<GateSweep, EvaluateError> {
    let thresholds = thresholds(ModelGate::of(model), frames);
    let cache = objects_at(model, set, frames, settings, &thresholds, step)?;
    let classes = class_names(model);
    let truths: Vec<FrameTruth> = frames.iter().map(|frame| frame.truth.clone()).collect();
    let asked: Vec<f64> = thresholds.iter().map(|t| f64::from(*t)).collect();
    let points = sweep(&truths, rules, &asked, |frame, at| {
        let objects = cache[frame][at].iter();
        objects.map(|o| o.to_detection(&classes)).collect()
    });
    let closed = points.first().map_or(0.0, |point| point.map_known);
    let best = best_point(&points, closed);
    Ok(GateSweep { points, best })
}

/// 0, which no box is below, then the grid.
fn thresholds(gate: ModelGate, frames: &[DetectedFrame]) -> Vec<f32> {
    let boxes = frames.iter().flat_map(|frame| &frame.detections);
    let values = boxes.map(|d| gate.value(d)).filter(|v| gate.may_be(*v));
    let scores: Vec<f64> = values.map(f64::from).collect();
    let grid = quantile_grid(&scores, THRESHOLDS);
    // The grid's values are boxes' own f32 values: they go back without loss.
    let grid = grid.into_iter().map(|t| t as f32);
    [0.0].into_iter().chain(grid).collect()
}

/// Published objects by frame, then by threshold; thresholds ascend. Frames go in parallel; the result does not depend
/// on the number of threads.
pub fn objects_at(
    model: &Model,
    set: &FrameSet,
    frames: &[DetectedFrame],
    settings: &Settings,
    thresholds: &[f32],
    step: &(dyn Fn() + Sync),
) -> Result<Vec<Vec<Vec<FoundObject>>>, EvaluateError> {
    let gate = ModelGate::of(model);
    over_frames(model, set, settings, step, |finder, index, points| {
        let boxes = &frames[index].detections[..];
        let mut found: Vec<Vec<FoundObject>> = Vec::with_capacity(thresholds.len());
        let mut before = None;
        for &threshold in thresholds {
            let fires = |d: &&Detection| gate.apply(d, true, threshold).is_some();
            let candidates = boxes.iter().filter(fires).count();
            // Thresholds ascend: as many candidates are the same candidates.
            let objects = match (before, found.last()) {
                (Some(count), Some(last)) if count == candidates => last.clone(),
                _ => {
                    let boxes = (boxes, frames[index].generic);
                    finder.objects(index as u64, points, boxes, threshold)
                }
            };
            before = Some(candidates);
            found.push(objects);
        }
        Ok(found)
    })
}

/// `each(finder, frame, points)` for every frame, in parallel, in order; `step` is called after each. The result must not depend on
/// what a finder did before.
pub fn over_frames<T: Send>(
    model: &Model,
    set: &FrameSet,
    settings: &Settings,
    step: &(dyn Fn() + Sync),
    each: impl Fn(&mut ObjectFinder, usize, &[Point]) -> Result<T, EvaluateError> + Sync,
) -> Result<Vec<T>, EvaluateError> {
    // A finder's buffers are large, so they go from frame to frame.
    let finder = || ObjectFinder::new(model, settings);
    let one = |finder: &mut Result<ObjectFinder, RefinerError>, frame: usize| {
        let finder = finder.as_mut().map_err(|e| e.clone())?;
        let found = each(finder, frame, &set.points(frame)?);
        step();
        found
    };
    (0..set.len())
        .into_par_iter()
        .map_init(finder, one)
        .collect()
}
