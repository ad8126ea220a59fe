//! `mluc-lab render`: a picture of a scan and its labels, from above.

use super::terminal::write_out;
use anyhow::bail;
use clap::Args;
use mluc_dataset::{Label, read_boxes, read_scan};
use mluc_gateway::picture::{BoxKind, Canvas, DrawnBox, View, bird_eye};
use mluc_geometry::Box3;
use std::path::PathBuf;

/// Draw a scan from above as a PNG, with the boxes of its labels.
#[derive(Args)]
pub(crate) struct RenderArguments {
    /// Scan: x, y, z, intensity as little-endian f32.
    #[arg(long)]
    scan: PathBuf,
    /// Labels in KITTI's format. Without it, label_2/NAME.txt beside the scan's folder is taken when it exists.
    #[arg(long)]
    labels: Option<PathBuf>,
    /// Calibration of the frame. Without it, calib/NAME.txt beside the scan's folder.
    #[arg(long)]
    calib: Option<PathBuf>,
    /// Show only what lies ahead, out to 70 m, instead of the full circle.
    #[arg(long)]
    ahead: bool,
    /// Picture to write.
    #[arg(long)]
    out: PathBuf,
}

pub(crate) fn run(arguments: RenderArguments) -> anyhow::Result<()> {
    write_out(&arguments.out, &arguments.draw()?.png())
}

impl RenderArguments {
    fn draw(&self) -> anyhow::Result<Canvas> {
        let points = read_scan(&self.scan)?;
        let boxes = self.labelled_boxes()?;
        let title = self.scan.file_stem().unwrap_or_default().to_string_lossy();
        let view = if self.ahead {
            View::ahead()
        } else {
            View::around()
        };
        let view = View {
            title: title.into_owned(),
            ..view
        };
        let drawn = boxes.into_iter().map(|(label, box_in_sensor)| DrawnBox {
            box_in_sensor,
            kind: BoxKind::Truth,
            label: label.class,
            caption: String::new(),
        });
        Ok(bird_eye(&points, &drawn.collect::<Vec<_>>(), &view))
    }

    /// The given file, or the scan's in a folder beside the scan's own.
    fn given_or_beside(&self, given: &Option<PathBuf>, folder: &str) -> Option<PathBuf> {
        let beside = || {
            let root = self.scan.parent()?.parent()?;
            let path = root
                .join(folder)
                .join(self.scan.with_extension("txt").file_name()?);
            path.is_file().then_some(path)
        };
        given.clone().or_else(beside)
    }

    fn labelled_boxes(&self) -> anyhow::Result<Vec<(Label, Box3)>> {
        let Some(path) = self.given_or_beside(&self.labels, "label_2") else {
            return Ok(Vec::new());
        };
        let Some(calibration) = self.given_or_beside(&self.calib, "calib") else {
            bail!(
                "{}: labels need a calibration: give --calib",
                path.display()
            );
        };
        Ok(read_boxes(&path, &calibration)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_tests::{NO_CAMERA, write_file};

    #[test]
    fn labels_are_drawn() {
        let folder = tempfile::tempdir().expect("a folder");
        let [scan, labels, calibration] =
            ["0.bin", "l.txt", "c.txt"].map(|name| folder.path().join(name));
        write_file(
            &scan,
            bytemuck::cast_slice::<_, u8>(&[[20.0f32, 15.0, -1.0, 0.0]]),
        );
        let car = "Car 0 0 0 0 0 100 100 1.5 1.6 4 0 1.7 20 -1.5708\n";
        write_file(&labels, car);
        write_file(&calibration, NO_CAMERA);
        let draw = |scan: &PathBuf, labels: Option<PathBuf>| {
            let arguments = RenderArguments {
                scan: scan.clone(),
                labels,
                calib: Some(calibration.clone()),
                ahead: true,
                out: PathBuf::new(),
            };
            let canvas = arguments.draw()?;
            // In the view ahead: the car 20 m before the sensor lies around row 504, column 400.
            let places = (460..550).flat_map(|y| (380..420).map(move |x| (x, y)));
            anyhow::Ok(places.map(|(x, y)| canvas.pixel(x, y)).collect::<Vec<_>>())
        };
        let (labelled, plain) = (draw(&scan, Some(labels)), draw(&scan, None));
        assert_ne!(labelled.expect("a picture"), plain.expect("a picture"));
        assert!(draw(&folder.path().join("none.bin"), None).is_err());
    }
}
