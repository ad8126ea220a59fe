//! A folder of frames.

use super::error::{Line, quoted};
use super::{DatasetError, Label, Result, read_calibration, read_labels, read_scan, read_text};
use mluc_geometry::{Box3, Calibration};
use std::{collections::HashSet, path::Path, path::PathBuf};

/// An opened folder in KITTI's format: its paths, and the names of its frames, in order.
#[derive(Clone, Debug)]
pub struct Dataset {
    root: PathBuf,
    scans: PathBuf,
    names: Vec<String>,
}

impl Dataset {
    /// Opens `root`. The scans are in `root/velodyne` where that exists, else in `root` itself. The frames are all scans
    /// (`*.bin`), sorted by name. A missing folder, or a folder without scans, is an error.
    pub fn open(root: &Path) -> Result<Dataset> {
        let inner = root.join("velodyne");
        let scans = if inner.is_dir() { &inner } else { root }.to_owned();
        let names = file_stems(&scans, "bin", "scans (*.bin)")?;
        Ok(Dataset { root: root.to_owned(), scans, names })
    }

    /// As [`Dataset::open`], but with a split only the frames that `root/ImageSets/SPLIT.txt` names, in its order.
    pub fn open_split<'a>(root: &Path, split: impl Into<Option<&'a str>>) -> Result<Dataset> {
        let list = |split: &str| root.join("ImageSets").join(format!("{split}.txt"));
        let listed = |split: &str| Dataset::open_listed(root, &list(split));
        split.into().map_or_else(|| Dataset::open(root), listed)
    }

    /// As [`Dataset::open`], but only the frames that a list names, one per line, in its order.
    pub fn open_listed(root: &Path, list: &Path) -> Result<Dataset> {
        let mut dataset = Dataset::open(root)?;
        let text = read_text(list)?;
        let mut seen = HashSet::new();
        let mut names = vec![];
        for (index, name) in text.lines().map(str::trim).enumerate() {
            let line = Line { path: list, index };
            if name.is_empty() {
                continue;
            }
            let known = |known: &String| known.as_str().cmp(name);
            if dataset.names.binary_search_by(known).is_err() {
                let expected = format!("the name of a frame in {}", dataset.scans.display());
                return Err(line.fault(expected, quoted(name)));
            }
            if !seen.insert(name) {
                let found = format!("{} again", quoted(name));
                return Err(line.fault("each frame once", found));
            }
            names.push(name.to_owned());
        }
        if names.is_empty() {
            return Err(DatasetError::at(list, "names of frames", "none"));
        }
        dataset.names = names;
        Ok(dataset)
    }

    /// The folder that was opened.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Names of the frames, without extension, in order; at least one.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Path of a frame's scan.
    pub fn scan_path(&self, name: &str) -> PathBuf {
        self.scans.join(format!("{name}.bin"))
    }

    fn text_path(&self, folder: &str, name: &str) -> PathBuf {
        self.root.join(folder).join(format!("{name}.txt"))
    }

    /// Path of a frame's labels.
    pub fn label_path(&self, name: &str) -> PathBuf {
        self.text_path("label_2", name)
    }

    /// Path of a frame's calibration.
    pub fn calibration_path(&self, name: &str) -> PathBuf {
        self.text_path("calib", name)
    }

    /// Path of a frame's ground plane, in data sets that have planes.
    pub fn plane_path(&self, name: &str) -> PathBuf {
        self.text_path("planes", name)
    }

    /// A frame's points: x, y, z (m, sensor frame), intensity; as recorded, not cleaned.
    pub fn scan(&self, name: &str) -> Result<Vec<[f32; 4]>> {
        read_scan(&self.scan_path(name))
    }

    /// A frame's labels, in file order, with DontCare.
    pub fn labels(&self, name: &str) -> Result<Vec<Label>> {
        read_labels(&self.label_path(name))
    }

    /// A frame's calibration.
    pub fn calibration(&self, name: &str) -> Result<Calibration> {
        read_calibration(&self.calibration_path(name))
    }

    /// A frame's labelled boxes in the sensor frame, with their labels, in file order, without DontCare.
    pub fn boxes_in_sensor(&self, name: &str) -> Result<Vec<(Label, Box3)>> {
        read_boxes(&self.label_path(name), &self.calibration_path(name))
    }
}

/// The labelled boxes of a label file and a calibration file, as in [`Dataset::boxes_in_sensor`].
pub fn read_boxes(labels: &Path, calibration: &Path) -> Result<Vec<(Label, Box3)>> {
    let calibration = read_calibration(calibration)?;
    let mut labels = read_labels(labels)?;
    labels.retain(|label| !label.is_dont_care());
    let in_sensor = |label: Label| {
        let box_in_sensor = calibration.box_in_sensor_from_label(&label.camera_box);
        (label, box_in_sensor)
    };
    Ok(labels.into_iter().map(in_sensor).collect())
}

/// Names without extension of the files `*.EXTENSION` of a folder, sorted. Hidden files belong to another system, and the `.pcd.bin` files of
/// nuScenes have another layout; both are skipped. `expected` says what the folder is for.
pub fn file_stems(folder: &Path, extension: &str, expected: &str) -> Result<Vec<String>> {
    if !folder.is_dir() {
        let found = if folder.exists() { "a file" } else { "nothing" };
        let expected = format!("a folder of {expected}");
        return Err(DatasetError::at(folder, expected, found));
    }
    let failed = DatasetError::read(folder);
    let mut stems = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(&failed)? {
        let path = entry.map_err(&failed)?.path();
        let matches = path.extension().is_some_and(|e| e == extension) && path.is_file();
        let stem = path.file_stem().and_then(|stem| stem.to_str());
        let is_other = |stem: &str| extension == "bin" && stem.ends_with(".pcd");
        let stem = stem.filter(|stem| matches && !stem.starts_with('.') && !is_other(stem));
        stems.extend(stem.map(str::to_owned));
    }
    if stems.is_empty() {
        return Err(DatasetError::at(folder, expected, "none"));
    }
    stems.sort();
    Ok(stems)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A folder with these files.
    pub(crate) fn folder_of(files: &[(&str, &str)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("a folder");
        for (name, content) in files {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().expect("a parent")).expect("a folder");
            std::fs::write(path, content).expect("written");
        }
        folder
    }

    #[test]
    fn frames_come_in_order_from_velodyne_or_the_folder_itself() {
        let names = ["b/2.bin", "b/1.bin", "b/notes.md", "a/velodyne/7.bin"];
        let folder = folder_of(&names.map(|name| (name, "")));
        let b = Dataset::open(&folder.path().join("b")).expect("scans");
        assert_eq!(b.names(), ["1", "2"]);
        let a = Dataset::open(&folder.path().join("a")).expect("scans");
        assert_eq!(a.scan_path("7"), folder.path().join("a/velodyne/7.bin"));
        assert!(a.scan("7").expect("a scan").is_empty());
    }

    #[test]
    fn splits_name_frames_that_exist() {
        let folder = folder_of(&[
            ("velodyne/1.bin", ""),
            ("velodyne/2.bin", ""),
            ("ImageSets/val.txt", "2\n"),
            ("ImageSets/bad.txt", "1\n9\n"),
            ("ImageSets/twice.txt", "1\n2\n\n1\n"),
        ]);
        let split = |name: &str| Dataset::open_split(folder.path(), name);
        assert_eq!(split("val").expect("a split").names(), ["2"]);
        for (name, line, fault) in [
            ("bad", 2, "the name of a frame in"),
            ("bad", 2, "found '9'"),
            ("twice", 4, "each frame once, found '1' again"),
        ] {
            let found = split(name).expect_err(fault).to_string();
            let place = format!("{name}.txt, line {line}: expected ");
            assert!(found.contains(&place) && found.contains(fault), "{found}");
        }
        assert!(split("none").is_err());
    }

    #[test]
    fn missing_and_empty_folders_are_named() {
        let folder = folder_of(&[]);
        for (name, fault) in [
            ("", "expected scans (*.bin), found none"),
            ("x", "expected a folder of scans (*.bin), found nothing"),
        ] {
            let found = Dataset::open(&folder.path().join(name)).expect_err(fault);
            assert!(found.to_string().ends_with(fault), "{found}");
        }
    }
}
