//! Boxes of the network as they are, gated by one score: naive, metric learning alone.

use super::MethodInput;
use mluc_evaluate::ObjectKind;
use mluc_evaluate::pipeline::{DetectedFrame, FoundObject, GatedObjects, ModelGate, THRESHOLDS};
use mluc_head::Detection;

/// A box as the network gives it, of a known class.
pub(super) fn known(d: &Detection) -> FoundObject {
    FoundObject::of_box(d, ObjectKind::Known, d.score)
}

/// Boxes below the threshold of a gate are unknown, as they are. Suppression among them changes nothing: the head's own
/// already went over all boxes alike.
pub(super) fn as_they_are(input: &MethodInput, gate: ModelGate) -> GatedObjects {
    let thresholds = input.thresholds(gate, input.frames, THRESHOLDS);
    let at = |frame: &DetectedFrame, threshold: f64| {
        let object = |d: &Detection| {
            if f64::from(gate.value(d)) < threshold {
                FoundObject::of_box(d, ObjectKind::Unknown, gate.rank(d))
            } else {
                known(d)
            }
        };
        frame.detections.iter().map(object).collect()
    };
    let objects = input.frames.iter().map(|frame| {
        (input.step)();
        thresholds.iter().map(|t| at(frame, *t)).collect()
    });
    let objects = objects.collect();
    input.output(thresholds, objects)
}
