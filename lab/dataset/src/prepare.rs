//! Converts a split of recorded scans for the trainer: only points in the camera's view; frames with unknown objects can be left out.
//!
//! KITTI labels only what its camera sees. The rest of the scan has no labels, so its points are dropped. Labels, calibrations and
//! road planes are copied; the list of frames is in `ImageSets`.

use super::{
    Dataset, DatasetError, KITTI_CLASSES, Result, Splits, check_classes, check_files, make_folders,
    read_text, scan_bytes, write_file,
};
use crate::whole_file::beside;
use mluc_geometry::{Calibration, ImageSize};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Points that project up to this far outside the image still belong to objects in it, px. KITTI's images differ in size by a few pixels.
const IMAGE_MARGIN_PX: f64 = 10.0;
/// What to write.
#[derive(Clone, Debug, PartialEq)]
pub struct PrepareOptions {
    /// Location of the frames and of their splits.
    pub splits: Splits,
    /// Name of the split.
    pub split: String,
    /// Leave out frames with any unknown object: for training. The paper does not describe its method; its object counts match this one. Without
    /// it these frames stay, with labels (for evaluation, and for the supervised network).
    pub drop_unknown: bool,
    /// Classes that stay unknown.
    pub unknown: Vec<String>,
    /// Folder to write; it must not exist.
    pub out: PathBuf,
}

/// Writes a split. `step` is called after each frame, from any thread. That every frame has a label file and a calibration, and the class of
/// every label, are checked before anything is written. The folder is written completely or not at all.
pub fn prepare(options: &PrepareOptions, step: impl Fn() + Sync) -> Result<()> {
    let dataset = options.splits.open(&options.split)?;
    check_files(&dataset)?;
    let names = dataset.names();
    let check = |name: &String| check_classes(&dataset.label_path(name), &KITTI_CLASSES);
    names.par_iter().try_for_each(check)?;
    if options.out.exists() {
        let expected = "a new folder";
        let found = "one that is there already; choose another or remove it";
        return Err(DatasetError::at(&options.out, expected, found));
    }
    let beside = beside(&options.out);
    if beside.is_dir() {
        std::fs::remove_dir_all(&beside).map_err(DatasetError::write(&beside))?;
    }
    let parts = ["velodyne", "label_2", "calib", "planes", "ImageSets"];
    make_folders(&beside, &parts)?;
    let one = |name: &String| {
        let kept = frame(options, &dataset, name, &beside)?;
        step();
        Ok(kept.then(|| format!("{name}\n")))
    };
    let kept: Vec<Option<String>> = names.par_iter().map(one).collect::<Result<_>>()?;
    let list: String = kept.into_iter().flatten().collect();
    if list.is_empty() {
        let expected = "frames without unknown objects";
        return Err(DatasetError::at(dataset.root(), expected, "none"));
    }
    let file = format!("ImageSets/{}.txt", options.split);
    write_file(&beside.join(file), list.as_bytes())?;
    std::fs::rename(&beside, &options.out).map_err(DatasetError::write(&options.out))
}

/// Writes one frame; returns whether it was kept.
fn frame(options: &PrepareOptions, dataset: &Dataset, name: &str, out: &Path) -> Result<bool> {
    if options.drop_unknown {
        let labels = dataset.labels(name)?;
        let is_unknown = |unknown: &String| labels.iter().any(|label| label.is(unknown));
        if options.unknown.iter().any(is_unknown) {
            return Ok(false);
        }
    }
    let calibration = dataset.calibration(name)?;
    let mut points = dataset.scan(name)?;
    points.retain(|point| in_view(&calibration, point));
    let scan = out.join(format!("velodyne/{name}.bin"));
    write_file(&scan, &scan_bytes(&points))?;
    // Lines are copied unchanged, with track ids.
    for (folder, path) in [
        ("label_2", dataset.label_path(name)),
        ("calib", dataset.calibration_path(name)),
        ("planes", dataset.plane_path(name)),
    ] {
        if folder != "planes" || path.is_file() {
            let file = out.join(folder).join(format!("{name}.txt"));
            write_file(&file, read_text(&path)?.as_bytes())?;
        }
    }
    Ok(true)
}

/// Whether a point is in the camera's view; without a camera every point is.
fn in_view(calibration: &Calibration, &[x, y, z, _]: &[f32; 4]) -> bool {
    if !calibration.has_camera() {
        return true;
    }
    let Some([u, v]) = calibration.project_point_to_image([x, y, z].map(f64::from)) else {
        return false;
    };
    let inside = |at: f64, size_px: u32| {
        (-IMAGE_MARGIN_PX..f64::from(size_px) + IMAGE_MARGIN_PX).contains(&at)
    };
    inside(u, ImageSize::KITTI.width_px) && inside(v, ImageSize::KITTI.height_px)
}
