//! Bringing a split of recorded scans into the trainer's form: only what the camera sees, unknown objects by policy.
//!
//! KITTI labels what its camera sees; the rest of the circle is unlabelled, so its points go. Labels, calibrations and road
//! planes are copied; the list of frames lies in `ImageSets`.

use super::policy::is_unknown;
use super::{
    Dataset, DatasetError, KITTI_CLASSES, Splits, UnknownPolicy, check_classes, check_files, erase,
    read_text,
};
use crate::whole_file::beside;
use mluc_geometry::{Box3, Calibration, ImageSize};
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
    /// What becomes of unknown objects; `None`: they stay, labelled (for judging, and for the supervised network).
    pub policy: Option<UnknownPolicy>,
    /// Classes that are to stay unknown.
    pub unknown: Vec<String>,
    /// Folder to write; must not exist.
    pub out: PathBuf,
}

/// Writes a split. `step` is called after each frame, from any thread. Everything is checked before anything is written: label and
/// calibration of every frame, classes of every label. The folder is there as a whole or not at all.
pub fn prepare(options: &PrepareOptions, step: impl Fn() + Sync) -> Result<(), DatasetError> {
    let dataset = options.splits.open(&options.split)?;
    check_files(&dataset)?;
    let names = dataset.names();
    names
        .par_iter()
        .try_for_each(|name| check_classes(&dataset.label_path(name), &KITTI_CLASSES))?;
    if options.out.exists() {
        let path = options.out.clone();
        return Err(DatasetError::NotNew { path });
    }
    let beside = beside(&options.out);
    if beside.is_dir() {
        std::fs::remove_dir_all(&beside).map_err(failed(&beside))?;
    }
    for part in ["velodyne", "label_2", "calib", "planes", "ImageSets"] {
        let folder = beside.join(part);
        std::fs::create_dir_all(&folder).map_err(failed(&folder))?;
    }
    let kept: Vec<bool> = names
        .par_iter()
        .map(|name| {
            let kept = frame(options, &dataset, name, &beside)?;
            step();
            Ok(kept)
        })
        .collect::<Result<_, DatasetError>>()?;
    let list: String = names
        .iter()
        .zip(&kept)
        .filter(|(_, kept)| **kept)
        .map(|(name, _)| format!("{name}\n"))
        .collect();
    if list.is_empty() {
        return Err(DatasetError::Empty {
            path: dataset.root().to_owned(),
            expected: "frames without unknown objects",
        });
    }
    write(
        &beside
            .join("ImageSets")
            .join(format!("{}.txt", options.split)),
        list.as_bytes(),
    )?;
    std::fs::rename(&beside, &options.out).map_err(failed(&options.out))
}

/// One frame; whether it was kept.
fn frame(
    options: &PrepareOptions,
    dataset: &Dataset,
    name: &str,
    out: &Path,
) -> Result<bool, DatasetError> {
    let labels = dataset.labels(name)?;
    if options
        .policy
        .is_some_and(|policy| !policy.keeps_frame(&labels, &options.unknown))
    {
        return Ok(false);
    }
    let calibration = dataset.calibration(name)?;
    let mut points = dataset.scan(name)?;
    points.retain(|point| in_view(&calibration, point));
    if options.policy == Some(UnknownPolicy::Erase) {
        let unknown = labels
            .iter()
            .filter(|label| is_unknown(label, &options.unknown));
        let boxes: Vec<Box3> = unknown
            .map(|label| calibration.box_in_sensor_from_label(&label.camera_box))
            .collect();
        erase(&mut points, &boxes);
    }
    let bytes: Vec<u8> = points
        .as_flattened()
        .iter()
        .flat_map(|value| value.to_le_bytes())
        .collect();
    write(&out.join("velodyne").join(format!("{name}.bin")), &bytes)?;
    let file = format!("{name}.txt");
    // Lines go over as they are, track ids and all.
    let keeps = |line: &&str| match (options.policy, line.split_whitespace().next()) {
        (Some(policy), Some(class)) => policy.keeps_label(class, &options.unknown),
        _ => true,
    };
    let text = read_text(&dataset.label_path(name))?;
    let lines: String = text
        .lines()
        .filter(keeps)
        .map(|line| format!("{line}\n"))
        .collect();
    write(&out.join("label_2").join(&file), lines.as_bytes())?;
    let calibration = read_text(&dataset.calibration_path(name))?;
    write(&out.join("calib").join(&file), calibration.as_bytes())?;
    let plane = dataset.plane_path(name);
    if plane.is_file() {
        write(
            &out.join("planes").join(&file),
            read_text(&plane)?.as_bytes(),
        )?;
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

fn write(path: &Path, bytes: &[u8]) -> Result<(), DatasetError> {
    std::fs::write(path, bytes).map_err(failed(path))
}

fn failed(path: &Path) -> impl FnOnce(std::io::Error) -> DatasetError {
    let path = path.to_owned();
    move |cause| DatasetError::Write { path, cause }
}
