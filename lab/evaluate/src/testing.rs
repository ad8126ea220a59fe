//! Labels and detections for tests: boxes of 4 m x 2 m x 1.5 m on the x axis, without a camera, high enough to count.

use crate::{CameraDetection, ObjectKind};
use mluc_dataset::Label;
use mluc_geometry::{Box3, Calibration};

/// A label that nothing hides.
pub(crate) fn label(class: &str, x_m: f64) -> Label {
    let shape = Box3::new([x_m, 0.0, 0.0, 4.0, 2.0, 1.5, 0.0]);
    Label {
        class: class.to_owned(),
        image_box_px: [0.0, 0.0, 100.0, 100.0],
        camera_box: Calibration::without_camera().label_from_box_in_sensor(&shape),
        ..Label::default()
    }
}

/// A detection just as large.
pub(crate) fn camera_detection(
    kind: ObjectKind,
    class: &str,
    x_m: f64,
    score: f64,
) -> CameraDetection {
    let label = label(class, x_m);
    CameraDetection {
        kind,
        class: class.to_owned(),
        score,
        image_box_px: label.image_box_px,
        upright: label.camera_box.upright(),
    }
}
