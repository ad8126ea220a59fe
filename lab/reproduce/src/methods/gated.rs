//! Boxes of the network as they are, gated by one score: closed set, supervised, naive, metric learning alone.

use super::MethodInput;
use mluc_evaluate::ObjectKind;
use mluc_evaluate::pipeline::{DetectedFrame, FoundObject, GatedObjects, ModelGate, THRESHOLDS};
use mluc_head::Detection;

/// A box as the network gives it, of a known class.
pub(super) fn known(d: &Detection) -> FoundObject {
    FoundObject::of_box(d, ObjectKind::Known, d.score)
}

/// Every box is what its class says. A class that counts as unknown is told by its name.
pub(super) fn all_known(input: &MethodInput) -> GatedObjects {
    each_frame(input, vec![0.0], |frame, _| {
        frame.detections.iter().map(known).collect()
    })
}

/// Boxes below the threshold of a gate are unknown, as they are. Suppression among them changes nothing: the head's own
/// already went over all boxes alike.
pub(super) fn as_they_are(input: &MethodInput, gate: ModelGate) -> GatedObjects {
    let thresholds = input.thresholds(gate, input.frames, THRESHOLDS);
    each_frame(input, thresholds, |frame, threshold| {
        let object = |d: &Detection| {
            if f64::from(gate.value(d)) < threshold {
                FoundObject::of_box(d, ObjectKind::Unknown, gate.rank(d))
            } else {
                known(d)
            }
        };
        frame.detections.iter().map(object).collect()
    })
}

fn each_frame(
    input: &MethodInput,
    thresholds: Vec<f64>,
    at: impl Fn(&DetectedFrame, f64) -> Vec<FoundObject>,
) -> GatedObjects {
    let objects = input.frames.iter().map(|frame| {
        (input.step)();
        thresholds.iter().map(|t| at(frame, *t)).collect()
    });
    let objects = objects.collect();
    input.output(thresholds, objects)
}
