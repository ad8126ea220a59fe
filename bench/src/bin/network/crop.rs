//! The part of a scan that KITTI's left colour camera sees, as its labels cover no more.

use std::path::Path;

use anyhow::{Context, Result};
use mluc_dataset::read_calibration;
use mluc_geometry::Calibration;

/// Edges of a picture, pixels: those of most of KITTI's.
const PICTURE: [f64; 2] = [1242.0, 375.0];

/// The camera of a scan, by its calibration: `.../velodyne/NAME.bin` has `.../calib/NAME.txt`.
pub(crate) struct View(Calibration);

impl View {
    pub(crate) fn of(scan: &Path) -> Result<View> {
        let folder = scan.parent().and_then(Path::parent);
        let folder = folder.context("a scan in a folder")?;
        let name = scan.file_stem().context("a scan with a name")?;
        let path = folder.join("calib").join(name).with_extension("txt");
        Ok(View(read_calibration(&path)?))
    }

    /// Whether a point lies in front of the camera and inside its picture.
    pub(crate) fn sees(&self, [x, y, z, _]: [f32; 4]) -> bool {
        let pixel = self.0.project_point_to_image([x, y, z].map(f64::from));
        pixel.is_some_and(|[u, v]| (0.0..PICTURE[0]).contains(&u) && (0.0..PICTURE[1]).contains(&v))
    }
}
