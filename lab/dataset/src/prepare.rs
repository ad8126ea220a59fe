//! Bringing a split of recorded scans into the trainer's form: only what the camera sees, unknown objects by policy.
//!
//! KITTI labels what its camera sees; the rest of the circle is unlabelled, so its points go. Labels, calibrations and road
//! planes are copied; the list of frames lies in `ImageSets`.

use super::{
    Dataset, DatasetError, KITTI_CLASSES, Label, Result, Splits, check_classes, check_files,
    make_folders, read_text, scan_bytes, write_file,
};
use crate::whole_file::beside;
use mluc_geometry::{Box3, Calibration, ImageSize, Inside};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Points that project so far beside the image still belong to things in it, px. KITTI's images differ by a few pixels in size.
const IMAGE_MARGIN_PX: f64 = 10.0;
/// An erased box is that much larger on every side, m: drawn boxes are not exact.
const ERASE_MARGIN_M: f64 = 0.2;

/// What training on recorded scans sees of objects that are to stay unknown. The paper does not say; its object counts fit the first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UnknownPolicy {
    /// A: frames with any unknown object are left out. No leakage of any kind; fits the paper's counts.
    DropFrames,
    /// B: their points are deleted, their place is ignored. More data; their shadows stay.
    Erase,
    /// C: points stay, labels go: unknown objects are trained as background. Wrong for open sets; for comparison.
    Background,
}

impl UnknownPolicy {
    /// All of them.
    pub const ALL: [UnknownPolicy; 3] = [
        UnknownPolicy::DropFrames,
        UnknownPolicy::Erase,
        UnknownPolicy::Background,
    ];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        ["drop_frames", "erase", "background"][self as usize]
    }
}

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
    let policy = options.policy;
    let is_unknown = |class: &str| {
        let mut unknown = options.unknown.iter();
        unknown.any(|name| name.eq_ignore_ascii_case(class))
    };
    let mut labels = dataset.labels(name)?;
    labels.retain(|label| is_unknown(&label.class));
    if policy == Some(UnknownPolicy::DropFrames) && !labels.is_empty() {
        return Ok(false);
    }
    let calibration = dataset.calibration(name)?;
    let mut points = dataset.scan(name)?;
    points.retain(|point| in_view(&calibration, point));
    if policy == Some(UnknownPolicy::Erase) {
        let in_sensor = |label: &Label| calibration.box_in_sensor_from_label(&label.camera_box);
        erase(&mut points, labels.iter().map(in_sensor));
    }
    let scan = out.join(format!("velodyne/{name}.bin"));
    write_file(&scan, &scan_bytes(&points))?;
    // Lines go over as they are, track ids and all.
    let is_left_out = |line: &str| {
        let class = line.split_whitespace().next();
        policy == Some(UnknownPolicy::Background) && class.is_some_and(is_unknown)
    };
    let labels = read_text(&dataset.label_path(name))?;
    let lines = labels.lines().filter(|line| !is_left_out(line));
    let mut texts = vec![
        ("label_2", lines.map(|line| format!("{line}\n")).collect()),
        ("calib", read_text(&dataset.calibration_path(name))?),
    ];
    let plane = dataset.plane_path(name);
    if plane.is_file() {
        texts.push(("planes", read_text(&plane)?));
    }
    for (folder, text) in texts {
        let file = out.join(folder).join(format!("{name}.txt"));
        write_file(&file, text.as_bytes())?;
    }
    Ok(true)
}

/// Deletes the points in boxes (sensor frame), each enlarged by [`ERASE_MARGIN_M`] on every side.
fn erase(points: &mut Vec<[f32; 4]>, boxes: impl Iterator<Item = Box3>) {
    let enlarged: Vec<Inside> = boxes.map(|b| Inside::of(&b, ERASE_MARGIN_M)).collect();
    points.retain(|point| !enlarged.iter().any(|b| b.has_point(point)));
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_in_and_just_beside_a_box_are_erased() {
        let b = Box3::new([10.0, 0.0, 0.0, 4.0, 2.0, 2.0, 0.0]);
        let mut points = [10.0, 12.1, 12.3, 0.0].map(|x| [x, 0.0, 0.0, 0.5]).to_vec();
        erase(&mut points, [b].into_iter());
        assert_eq!(points, [[12.3, 0.0, 0.0, 0.5], [0.0, 0.0, 0.0, 0.5]]);
    }
}
