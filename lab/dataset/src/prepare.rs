//! Bringing a split of recorded scans into the trainer's form: only what the camera sees; frames with unknown objects can be left out.
//!
//! KITTI labels what its camera sees; the rest of the circle is unlabelled, so its points go. Labels, calibrations and road
//! planes are copied; the list of frames lies in `ImageSets`.

use super::{
    Dataset, DatasetError, KITTI_CLASSES, Result, Splits, check_classes, check_files, make_folders,
    read_text, scan_bytes, write_file,
};
use crate::whole_file::beside;
use mluc_geometry::{Calibration, ImageSize};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Points that project so far beside the image still belong to things in it, px. KITTI's images differ by a few pixels in size.
const IMAGE_MARGIN_PX: f64 = 10.0;
/// What to write.
#[derive(Clone, Debug, PartialEq)]
pub struct PrepareOptions {
    /// Where the frames are and how they are split.
    pub splits: Splits,
    /// Which split.
    pub split: String,
    /// Leave out frames with any unknown object: for training. The paper does not say how it did that; its object counts fit this. Without it
    /// they stay, labelled (for judging, and for the supervised network).
    pub drop_unknown: bool,
    /// Classes that are to stay unknown.
    pub unknown: Vec<String>,
    /// Folder to write; must not exist.
    pub out: PathBuf,
}

/// Writes a split. `step` is called after each frame, from any thread. Everything is checked before anything is written: label and
/// calibration of every frame, classes of every label. The folder is there as a whole or not at all.
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
    let kept = names.par_iter().map(one);
    let kept: Vec<Option<String>> = kept.collect::<Result<_>>()?;
    let list: String = kept.into_iter().flatten().collect();
    if list.is_empty() {
        let expected = "frames without unknown objects";
        return Err(DatasetError::at(dataset.root(), expected, "none"));
    }
    let file = format!("ImageSets/{}.txt", options.split);
    write_file(&beside.join(file), list.as_bytes())?;
    std::fs::rename(&beside, &options.out).map_err(DatasetError::write(&options.out))
}

/// One frame; whether it was kept.
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
    // Lines go over as they are, track ids and all.
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

/// Whether a point lies in the camera's view; all do where there is no camera.
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
