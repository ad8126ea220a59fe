//! Methods that keep the network's boxes: closed set, supervised, naive, metric learning alone.

use super::{Input, MethodError, Swept, UnknownScore};
use crate::evaluate::Kind;
use crate::pipeline::{FoundObject, THRESHOLDS};
use mluc_head::Detection;

/// Every box is what its class says. A class that counts as unknown is told by its name.
pub(super) fn all_known(input: &Input) -> Result<Swept, MethodError> {
    let known = |d: &Detection| FoundObject::of_box(d, Kind::Known, d.score);
    let objects = input.frames.iter().map(|frame| {
        (input.step)();
        vec![frame.detections.iter().map(known).collect()]
    });
    Ok((vec![0.0], objects.collect()))
}

/// Boxes whose score lies below the threshold are unknown, as they are. Suppression among them changes nothing: the head's own
/// already went over all boxes alike.
pub(super) fn gated(input: &Input, score: UnknownScore) -> Result<Swept, MethodError> {
    let of = |d: &Detection| f64::from(score.of(d));
    let boxes = input.frames.iter().flat_map(|frame| &frame.detections);
    let thresholds = input.thresholds_over(&boxes.map(of).collect::<Vec<_>>(), THRESHOLDS);
    let at = |frame: &[Detection], threshold: f64| -> Vec<FoundObject> {
        let object = |d: &Detection| match of(d) < threshold {
            true => FoundObject::of_box(d, Kind::Unknown, score.rank(d)),
            false => FoundObject::of_box(d, Kind::Known, d.score),
        };
        frame.iter().map(object).collect()
    };
    let objects = input.frames.iter().map(|frame| {
        (input.step)();
        thresholds
            .iter()
            .map(|t| at(&frame.detections, *t))
            .collect()
    });
    let objects = objects.collect();
    Ok((thresholds, objects))
}
