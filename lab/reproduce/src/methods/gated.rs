//! Unchanged boxes of the network, gated by one score: naive, and metric learning only.

use super::MethodInput;
use mluc_evaluate::SensorDetection;
use mluc_evaluate::pipeline::{DetectedFrame, GatedObjects, ModelGate, THRESHOLDS, box_of};
use mluc_head::Detection;

/// Boxes below the threshold of a gate are unknown, with their box unchanged. A further suppression changes almost nothing: the head's own covers all boxes.
pub(super) fn as_they_are(input: &MethodInput, gate: ModelGate) -> GatedObjects {
    let thresholds = input.thresholds(gate, input.frames, THRESHOLDS);
    let classes = input.model.manifest.class_names();
    let at = |frame: &DetectedFrame, threshold: f64| {
        let object = |d: &Detection| {
            if f64::from(gate.value(d)) < threshold {
                SensorDetection::unknown(gate.rank(d), box_of(d))
            } else {
                SensorDetection::of_box(d, &classes)
            }
        };
        frame.detections.iter().map(object).collect()
    };
    let objects = input.frames.iter().map(|frame| {
        (input.step)();
        thresholds.iter().map(|t| at(frame, *t)).collect()
    });
    GatedObjects { objects: objects.collect(), thresholds }
}
