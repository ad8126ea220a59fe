//! Labels and detections of one scan, in one comparable form.

use crate::UNKNOWN;
use mluc_dataset::Label;
use mluc_geometry::{Box3, Calibration, CameraBox, ImageSize};
use mluc_ipc_types::ObjectKind;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// The image box of every object where there is no camera: high enough for every difficulty.
const IMAGE_BOX_WITHOUT_CAMERA_PX: [f64; 4] = [0.0, 0.0, 100.0, 100.0];
/// Value of [`Label::occluded`] (unknown) with which a label counts at no difficulty.
const NEVER_COUNTED: i32 = 3;

/// A detected object, in the sensor frame. Its JSON is part of the object that the pipeline prints.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensorDetection {
    /// Known or unknown.
    #[serde(with = "KindName")]
    pub kind: ObjectKind,
    /// Class name; free for an unknown object.
    #[serde(rename = "label")]
    pub class: String,
    /// Confidence; higher is better; finite.
    pub score: f64,
    /// Probability that the object is of its kind, where the model provides it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub probability: Option<f64>,
    /// Track id, where objects are tracked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub track: Option<u32>,
    /// The box.
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
    // The reader ensures that every detection has a score.
    detection.score.unwrap_or_default()
}

/// A labelled frame without detections.
#[derive(Clone, Debug)]
pub struct FrameTruth {
    /// Labels in file order, with DontCare. Shared: a sweep uses them once per threshold.
    pub labels: Arc<[Label]>,
    /// Converts sensor boxes into label boxes and image boxes. Without a camera (P2 all 0) nothing is outside the image.
    pub calibration: Calibration,
    /// Size of the image.
    pub image: ImageSize,
}

impl FrameTruth {
    /// A box in the image and in the camera frame; `None` where there is an image and the whole box is outside it.
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

    /// The frame with these detections; detections outside the image are dropped.
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
    /// Labels in file order, with DontCare.
    pub labels: Arc<[Label]>,
    /// Detections in file order, which breaks ties in score; an unknown object is of class [`UNKNOWN`].
    pub detections: Vec<Label>,
}

/// Distance of a box in the ground plane, m. Upright boxes are relative to the camera, which is close to the sensor.
pub(crate) fn range_m(upright: &Box3) -> f64 {
    upright.center_m[0].hypot(upright.center_m[1])
}

impl LabelledFrame {
    /// Leaves out what is farther than `range_max_m` in the ground plane, by the centres of the boxes: detections are removed; labels stay, but may
    /// be found or not, so that a near detection of a far object is not wrong. Ranges are from the origin of the labels' frame: KITTI's camera, 0.3 m ahead of the sensor.
    pub fn limit_range(&mut self, range_max_m: f64) {
        let is_far = |object: &Label| range_m(&object.camera_box.upright()) > range_max_m;
        self.detections.retain(|detection| !is_far(detection));
        let mut labels = self.labels.to_vec();
        for label in labels.iter_mut().filter(|label| is_far(label)) {
            label.occluded = NEVER_COUNTED;
        }
        self.labels = labels.into();
    }
}
