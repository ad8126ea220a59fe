//! Methods that cluster the points of the gated boxes: UC alone, MLUC to the letter, MLUC corrected.

use super::{Input, MethodError, Swept, UnknownScore};
use crate::pipeline::{FoundObject, ObjectFinder, THRESHOLDS};
use mluc_head::Detection;
use mluc_ipc_types::{DetectionKind, Point};
use mluc_refiner::{Mode, Settings};
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

/// Boxes whose score lies below the threshold go to the refiner in this mode. The refiner ranks by 1 / EDS as the paper does; with
/// another gate the boxes carry that gate's score in the EDS' place.
pub(super) fn gated(input: &Input, score: UnknownScore, mode: Mode) -> Result<Swept, MethodError> {
    let of = |d: &Detection| f64::from(score.of(d));
    let boxes = input.frames.iter().flat_map(|frame| &frame.detections);
    let thresholds = input.thresholds_over(&boxes.map(of).collect::<Vec<_>>(), THRESHOLDS);
    let settings = Settings {
        mode,
        ..Settings::default()
    };
    let gate = |d: &Detection, threshold: f64| {
        let kind = match of(d) < threshold {
            true => DetectionKind::Candidate,
            false => DetectionKind::Known,
        };
        let eds = if score == UnknownScore::Eds {
            d.eds
        } else {
            1.0 / score.rank(d).max(1e-6)
        };
        Detection {
            kind: kind as u32,
            eds,
            ..*d
        }
    };
    let objects = over_frames(input, &settings, |finder, frame, points| {
        let detections = &input.frames[frame].detections;
        let mut before: Option<(usize, Vec<FoundObject>)> = None;
        let at = |threshold: &f64| {
            let gated: Vec<Detection> = detections.iter().map(|d| gate(d, *threshold)).collect();
            let count = gated.iter().filter(|d| d.is_candidate()).count();
            // The candidates of one threshold are among those of any higher one: as many are the same.
            let found = match before.take() {
                Some((last, found)) if last == count => found,
                _ => finder.objects_of(frame as u64, points, gated.into_iter()),
            };
            before = Some((count, found.clone()));
            found
        };
        thresholds.iter().map(at).collect()
    })?;
    Ok((thresholds, objects))
}

/// `each(finder, frame, points)` for every frame, in parallel, in order.
pub(super) fn over_frames<T: Send>(
    input: &Input,
    settings: &Settings,
    each: impl Fn(&mut ObjectFinder, usize, &[Point]) -> T + Sync,
) -> Result<Vec<T>, MethodError> {
    // One finder a thread at a time: its buffers are large, so they go from frame to frame.
    let spare: Mutex<Vec<ObjectFinder>> = Mutex::new(vec![]);
    let lock = || spare.lock().unwrap_or_else(PoisonError::into_inner);
    let one = |frame: usize| -> Result<T, MethodError> {
        let taken = lock().pop();
        let mut finder = match taken {
            Some(finder) => finder,
            None => ObjectFinder::new(input.model, settings)?,
        };
        let points = input.set.points(frame)?;
        let found = each(&mut finder, frame, &points);
        lock().push(finder);
        (input.step)();
        Ok(found)
    };
    (0..input.frames.len()).into_par_iter().map(one).collect()
}
