//! Methods that gate the network's boxes by one score: closed set, supervised, naive, metric learning alone (the boxes as they are);
//! UC alone, MLUC as in the paper and corrected (the points of the gated boxes clustered).

use super::{MethodInput, Swept};
use crate::ReproduceError;
use mluc_evaluate::ObjectKind;
use mluc_evaluate::pipeline::{FoundObject, THRESHOLDS, over_frames};
use mluc_head::Detection;
use mluc_ipc_types::DetectionKind;
use mluc_refiner::{Settings, Variant};

/// What a method gates by: low is unknown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum UnknownScore {
    /// The normalised EDS (paper section 3.2).
    Eds,
    /// The largest class probability.
    Msp,
}

impl UnknownScore {
    /// Of a box.
    pub(super) fn of(self, detection: &Detection) -> f32 {
        match self {
            UnknownScore::Eds => detection.eds_normalised,
            UnknownScore::Msp => detection.softmax_max,
        }
    }

    /// What orders unknown objects among each other where nothing else does: the paper's 1 / EDS, or 1 - the probability.
    fn rank(self, detection: &Detection) -> f32 {
        match self {
            UnknownScore::Eds => 1.0 / detection.eds.max(1e-6),
            UnknownScore::Msp => 1.0 - detection.softmax_max,
        }
    }

    fn is_unknown(self, detection: &Detection, threshold: f64) -> bool {
        f64::from(self.of(detection)) < threshold
    }
}

/// A box as the network gives it, of a known class.
pub(super) fn known(d: &Detection) -> FoundObject {
    FoundObject::of_box(d, ObjectKind::Known, d.score)
}

/// Every box is what its class says. A class that counts as unknown is told by its name.
pub(super) fn all_known(input: &MethodInput) -> Swept {
    let objects = input.frames.iter().map(|frame| {
        (input.step)();
        vec![frame.detections.iter().map(known).collect()]
    });
    (vec![0.0], objects.collect())
}

/// Boxes whose score lies below the threshold are unknown, as they are. Suppression among them changes nothing: the head's own
/// already went over all boxes alike.
pub(super) fn as_they_are(input: &MethodInput, score: UnknownScore) -> Swept {
    let thresholds = input.thresholds_over(input.boxes().map(|d| score.of(d)), THRESHOLDS);
    let at = |boxes: &[Detection], threshold: f64| -> Vec<FoundObject> {
        let object = |d: &Detection| {
            if score.is_unknown(d, threshold) {
                FoundObject::of_box(d, ObjectKind::Unknown, score.rank(d))
            } else {
                known(d)
            }
        };
        boxes.iter().map(object).collect()
    };
    let objects = input.frames.iter().map(|frame| {
        (input.step)();
        let at = |t: &f64| at(&frame.detections, *t);
        thresholds.iter().map(at).collect()
    });
    let objects = objects.collect();
    (thresholds, objects)
}

/// Boxes whose score lies below the threshold go to the refiner in this variant. The refiner ranks by 1 / EDS as the paper does; with
/// another gate the boxes carry that gate's score in the EDS' place.
pub(super) fn refined(
    input: &MethodInput,
    score: UnknownScore,
    variant: Variant,
) -> Result<Swept, ReproduceError> {
    let thresholds = input.thresholds_over(input.boxes().map(|d| score.of(d)), THRESHOLDS);
    let settings = Settings {
        variant,
        ..Settings::default()
    };
    let gate = |d: &Detection, threshold: f64| {
        let kind = if score.is_unknown(d, threshold) {
            DetectionKind::Candidate
        } else {
            DetectionKind::Known
        };
        let eds = match score {
            UnknownScore::Eds => d.eds,
            UnknownScore::Msp => 1.0 / score.rank(d).max(1e-6),
        };
        Detection {
            kind: kind as u32,
            eds,
            ..*d
        }
    };
    let (model, set, step) = (input.model, input.set, input.step);
    let objects = over_frames(model, set, &settings, step, |finder, frame, points| {
        let mut before: Option<(usize, Vec<FoundObject>)> = None;
        let at = |threshold: &f64| {
            let boxes = input.frames[frame].detections.iter();
            let gated: Vec<Detection> = boxes.map(|d| gate(d, *threshold)).collect();
            let count = gated.iter().filter(|d| d.is_candidate()).count();
            // The candidates of one threshold are among those of any higher one: as many are the same.
            let found = match before.take() {
                Some((last, found)) if last == count => found,
                _ => finder.objects_of(frame as u64, points, gated.into_iter()),
            };
            before = Some((count, found.clone()));
            found
        };
        Ok(thresholds.iter().map(at).collect())
    })?;
    Ok((thresholds, objects))
}
