//! What was labelled and what was found in one scan, made comparable.

use crate::UNKNOWN;
use mluc_dataset::Label;
use mluc_geometry::{Box3, Calibration, CameraBox, ImageSize};
use mluc_ipc_types::ObjectKind;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// The image box of everything where there is no camera: high enough for every difficulty.
const IMAGE_BOX_WITHOUT_CAMERA_PX: [f64; 4] = [0.0, 0.0, 100.0, 100.0];

/// An object that was found, in the sensor frame. Its JSON is part of what the pipeline prints of an object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensorDetection {
    /// Known or unknown.
    #[serde(with = "KindName")]
    pub kind: ObjectKind,
    /// Class name (of an unknown: any).
    #[serde(rename = "label")]
    pub class: String,
    /// Confidence; higher is better; finite.
    pub score: f64,
    /// How likely it is one of its kind, where the model tells it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub probability: Option<f64>,
    /// Number of its track, where objects are followed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub track: Option<u32>,
    /// Where it is.
    #[serde(flatten, with = "BoxFields")]
    pub box_in_sensor: Box3,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "ObjectKind", rename_all = "lowercase")]
enum KindName {
    Known,
    Unknown,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "Box3")]
struct BoxFields {
    center_m: [f64; 3],
    size_m: [f64; 3],
    yaw_rad: f64,
}

/// A detection's confidence.
pub(crate) fn score_of(detection: &Label) -> f64 {
    // The reader has seen to it that detections have one.
    detection.score.unwrap_or_default()
}

/// A labelled frame that waits for detections.
#[derive(Clone, Debug)]
pub struct FrameTruth {
    /// Labels in file order, DontCare among them. Shared: a sweep uses them once a threshold.
    pub labels: Arc<[Label]>,
    /// Turns sensor boxes into label boxes and image boxes. Without a camera (P2 all 0) nothing lies outside an image.
    pub calibration: Calibration,
    /// Size of the image.
    pub image: ImageSize,
}

impl FrameTruth {
    /// A box in the image and in the camera frame; `None` when there is an image and nothing of the box lies in it.
    pub(crate) fn in_camera(&self, box_in_sensor: &Box3) -> Option<([f64; 4], CameraBox)> {
        let calibration = &self.calibration;
        let camera_box = calibration.label_from_box_in_sensor(box_in_sensor);
        let image_box_px = if calibration.has_camera() {
            calibration.project_label_to_image(&camera_box, self.image)?
        } else {
            IMAGE_BOX_WITHOUT_CAMERA_PX
        };
        Some((image_box_px, camera_box))
    }

    /// The frame with what was found in it; what lies outside the image is dropped.
    pub fn with(&self, found: &[SensorDetection]) -> LabelledFrame {
        let detection = |found: &SensorDetection| {
            let (image_box_px, camera_box) = self.in_camera(&found.box_in_sensor)?;
            let is_unknown = found.kind == ObjectKind::Unknown;
            Some(Label {
                class: if is_unknown { UNKNOWN } else { &found.class }.to_owned(),
                image_box_px,
                camera_box,
                score: Some(found.score),
                probability: found.probability,
                track: found.track,
                ..Label::default()
            })
        };
        LabelledFrame {
            labels: Arc::clone(&self.labels),
            detections: found.iter().filter_map(detection).collect(),
        }
    }
}

/// Labels and detections of one frame.
#[derive(Clone, Debug)]
pub struct LabelledFrame {
    /// Labels in file order, DontCare among them.
    pub labels: Arc<[Label]>,
    /// Detections in file order, which settles ties in score; an unknown object is of class [`UNKNOWN`].
    pub detections: Vec<Label>,
}
