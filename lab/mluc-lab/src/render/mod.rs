//! A picture of a scan and its labels, from above.

use mluc_dataset::{DatasetError, Label, read_calibration, read_labels, read_scan};
use mluc_gateway::picture::{
    BoxKind, Canvas, Color, DrawnBox, PointColor, View, bird_eye, label_color,
};
use mluc_geometry::Box3;
use std::path::{Path, PathBuf};

/// Colour of points outside of every box when points are coloured by label.
const OUTSIDE: Color = [74, 84, 98];

/// How points are coloured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn write(root: &Path, name: &str, bytes: &[u8]) -> PathBuf {
        let path = root.join(name);
        std::fs::write(&path, bytes).expect("written");
        path
    }

    #[test]
    fn points_in_a_labelled_box_take_its_colour() {
        let folder = tempfile::tempdir().expect("a folder");
        // One point in the car's box 20 m ahead, in the middle of a pixel, one far beside it.
        let points = [[19.95f32, -0.05, -1.0, 0.0], [20.0, 15.0, -1.0, 0.0]];
        let bytes: Vec<u8> = points
            .as_flattened()
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect();
        let scan = write(folder.path(), "0.bin", &bytes);
        let labels = write(
            folder.path(),
            "l.txt",
            b"Car 0 0 0 0 0 100 100 1.5 1.6 4 0 1.7 20 -1.5708\n",
        );
        let calibration = write(
            folder.path(),
            "c.txt",
            b"P2: 0 0 0 0 0 0 0 0 0 0 0 0\nR0_rect: 1 0 0 0 1 0 0 0 1\nTr_velo_to_cam: 0 -1 0 0 0 0 -1 0 1 0 0 0\n",
        );
        let options = |labels| RenderOptions {
            scan: scan.clone(),
            labels,
            color: ColorBy::Label,
            px_per_m: 10.0,
            ahead: true,
        };
        // In the view ahead, 20 m before the sensor in the middle: row 504, column 400.
        let at = |canvas: &Canvas| canvas.pixel(400, 504).expect("inside");
        let labelled = render(&options(Some((labels, calibration)))).expect("a picture");
        let plain = render(&options(None)).expect("a picture");
        assert_ne!(at(&labelled), at(&plain));
        assert!(at(&labelled)[2] > 180, "{:?}", at(&labelled));
        assert!(
            render(&RenderOptions {
                scan: folder.path().join("none.bin"),
                ..options(None)
            })
            .is_err()
        );
    }
}
