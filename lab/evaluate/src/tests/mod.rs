//! Labels and detections for tests.

mod average_precision;
mod open_set;

use crate::LabelledFrame;
use mluc_dataset::Label;
use mluc_geometry::CameraBox;

/// An object of 4 m x 1.6 m x 1.5 m, 50 px high, without occlusion; others are next to it in space and in the image.
pub(crate) fn label(class: &str, x_m: f64) -> Label {
    let left = 6.0 * x_m;
    Label {
        class: class.to_owned(),
        image_box_px: [left, 100.0, left + 50.0, 150.0],
        camera_box: CameraBox {
            location_m: [x_m, 1.7, 20.0],
            size_hwl_m: [1.5, 1.6, 4.0],
            rotation_y_rad: 0.3,
        },
        ..Label::default()
    }
}

/// A detection at exactly this label.
pub(crate) fn found(label: &Label, class: &str, score: f64) -> Label {
    Label { class: class.to_owned(), score: Some(score), ..label.clone() }
}

/// A detection where a label with this x would be.
pub(crate) fn found_at(x_m: f64, class: &str, score: f64) -> Label {
    found(&label("", x_m), class, score)
}

pub(crate) fn frame(labels: Vec<Label>, detections: Vec<Label>) -> LabelledFrame {
    LabelledFrame { labels: labels.into(), detections }
}
