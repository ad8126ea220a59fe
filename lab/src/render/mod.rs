//! A picture of a scan and its labels, from above.

use crate::dataset::{DatasetError, Label, read_calibration, read_labels, read_scan};
use mluc_gateway::picture::{
    BoxKind, Canvas, Color, DrawnBox, PointColor, View, bird_eye, label_color,
};
use mluc_geometry::Box3;
use std::path::{Path, PathBuf};

/// Colour of points outside of every box when points are coloured by label.
const OUTSIDE: Color = [74, 84, 98];

/// How points are coloured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColorBy {
    /// By height over the sensor.
    Height,
    /// By the class of the box that a point lies in.
    Label,
}

/// What to draw.
#[derive(Clone, Debug)]
pub struct RenderOptions {
    /// The scan (`*.bin`).
    pub scan: PathBuf,
    /// Labels and the calibration that takes them to the sensor frame.
    pub labels: Option<(PathBuf, PathBuf)>,
    /// Colours of the points.
    pub color: ColorBy,
    /// Pixels a metre.
    pub px_per_m: f32,
    /// Only what lies ahead; otherwise the full circle.
    pub ahead: bool,
}

/// Draws one scan.
pub fn render(options: &RenderOptions) -> Result<Canvas, DatasetError> {
    let points = read_scan(&options.scan)?;
    let boxes = match &options.labels {
        Some((labels, calibration)) => labelled_boxes(labels, calibration)?,
        None => Vec::new(),
    };
    let color = match options.color {
        ColorBy::Height => PointColor::Height,
        ColorBy::Label => {
            PointColor::Each(points.iter().map(|p| color_inside(p, &boxes)).collect())
        }
    };
    let base = if options.ahead {
        View::ahead()
    } else {
        View::around()
    };
    let title = options
        .scan
        .file_stem()
        .map(|s| s.to_string_lossy().into_owned())
        .unwrap_or_default();
    let view = View {
        px_per_m: options.px_per_m,
        color,
        title,
        ..base
    };
    let drawn: Vec<DrawnBox> = boxes.iter().map(|(label, b)| drawn(label, *b)).collect();
    Ok(bird_eye(&points, &drawn, &view))
}

fn labelled_boxes(labels: &Path, calibration: &Path) -> Result<Vec<(Label, Box3)>, DatasetError> {
    let calibration = read_calibration(calibration)?;
    let labels = read_labels(labels)?
        .into_iter()
        .filter(|label| !label.is_dont_care());
    Ok(labels
        .map(|label| {
            let box_in_sensor = calibration.box_in_sensor_from_label(&label.camera_box);
            (label, box_in_sensor)
        })
        .collect())
}

fn color_inside(point: &[f32; 4], boxes: &[(Label, Box3)]) -> Color {
    let at = [point[0], point[1], point[2]].map(f64::from);
    boxes
        .iter()
        .find(|(_, b)| b.contains(at))
        .map_or(OUTSIDE, |(label, _)| label_color(&label.class))
}

fn drawn(label: &Label, box_in_sensor: Box3) -> DrawnBox {
    DrawnBox {
        box_in_sensor,
        kind: BoxKind::Truth,
        label: label.class.clone(),
        caption: String::new(),
    }
}
