//! A folder of frames.

use super::{DatasetError, Label, read_calibration, read_labels, read_scan, read_text};
use mluc_geometry::{Box3, Calibration};
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// A KITTI-format folder, opened: where its files lie and the names of its frames, in order.
#[derive(Clone, Debug)]
pub struct Dataset {
    root: PathBuf,
    scans: PathBuf,
    names: Vec<String>,
}

impl Dataset {
    /// Opens `root`: the scans lie in `root/velodyne` where that exists, else in `root` itself. Frames are all scans
    /// (`*.bin`) by name. A missing folder, or one without scans, is an error.
    pub fn open(root: &Path) -> Result<Dataset, DatasetError> {
        let inner = root.join("velodyne");
        let scans = if inner.is_dir() {
            inner
        } else {
            root.to_owned()
        };
        let names = file_stems(&scans, "bin", "scans (*.bin)")?;
        Ok(Dataset {
            root: root.to_owned(),
            scans,
            names,
        })
    }

    /// [`Dataset::open`], then only the frames that `root/ImageSets/SPLIT.txt` names, in its order.
    pub fn open_split(root: &Path, split: &str) -> Result<Dataset, DatasetError> {
        Dataset::open_listed(root, &root.join("ImageSets").join(format!("{split}.txt")))
    }

    /// [`Dataset::open`], then only the frames that a list names, one a line, in its order.
    pub fn open_listed(root: &Path, list: &Path) -> Result<Dataset, DatasetError> {
        let mut dataset = Dataset::open(root)?;
        let text = read_text(list)?;
        let (mut names, mut seen) = (Vec::new(), HashSet::new());
        for (index, name) in text
            .lines()
            .map(str::trim)
            .enumerate()
            .filter(|(_, name)| !name.is_empty())
        {
            if dataset
                .names
                .binary_search_by(|known| known.as_str().cmp(name))
                .is_err()
            {
                return Err(DatasetError::UnknownFrame {
                    path: list.to_owned(),
                    line: index + 1,
                    scans: dataset.scans,
                    found: name.chars().take(40).collect(),
                });
            }
            if !seen.insert(name) {
                return Err(DatasetError::RepeatedFrame {
                    path: list.to_owned(),
                    line: index + 1,
                    found: name.chars().take(40).collect(),
                });
            }
            names.push(name.to_owned());
        }
        if names.is_empty() {
            return Err(DatasetError::Empty {
                path: list.to_owned(),
                expected: "names of frames",
            });
        }
        dataset.names = names;
        Ok(dataset)
    }

    /// The folder that was opened.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Names of the frames, without extension, in order.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Number of frames; at least 1.
    pub fn len(&self) -> usize {
        self.names.len()
    }

    /// Whether there is no frame (an open data set has one).
    pub fn is_empty(&self) -> bool {
        self.names.is_empty()
    }

    /// Where a frame's scan lies.
    pub fn scan_path(&self, name: &str) -> PathBuf {
        self.scans.join(format!("{name}.bin"))
    }

    /// Where a frame's labels lie.
    pub fn label_path(&self, name: &str) -> PathBuf {
        self.root.join("label_2").join(format!("{name}.txt"))
    }

    /// Where a frame's calibration lies.
    pub fn calibration_path(&self, name: &str) -> PathBuf {
        self.root.join("calib").join(format!("{name}.txt"))
    }

    /// A frame's points: x, y, z (m, sensor frame), intensity; as recorded, not cleaned.
    pub fn scan(&self, name: &str) -> Result<Vec<[f32; 4]>, DatasetError> {
        read_scan(&self.scan_path(name))
    }

    /// A frame's labels, in file order, DontCare among them.
    pub fn labels(&self, name: &str) -> Result<Vec<Label>, DatasetError> {
        read_labels(&self.label_path(name))
    }

    /// A frame's calibration.
    pub fn calibration(&self, name: &str) -> Result<Calibration, DatasetError> {
        read_calibration(&self.calibration_path(name))
    }

    /// A frame's labelled boxes in the sensor frame, with their labels, in file order, DontCare left out.
    pub fn boxes_in_sensor(&self, name: &str) -> Result<Vec<(Label, Box3)>, DatasetError> {
        let calibration = self.calibration(name)?;
        let labels = self
            .labels(name)?
            .into_iter()
            .filter(|label| !label.is_dont_care());
        Ok(labels
            .map(|label| {
                let box_in_sensor = calibration.box_in_sensor_from_label(&label.camera_box);
                (label, box_in_sensor)
            })
            .collect())
    }

    /// Where a frame's ground plane lies, in the data sets that have planes.
    pub fn plane_path(&self, name: &str) -> PathBuf {
        self.root.join("planes").join(format!("{name}.txt"))
    }
}

/// Names without extension of the files `*.EXTENSION` of a folder, sorted. `expected` says what the folder is for.
pub fn file_stems(
    folder: &Path,
    extension: &str,
    expected: &'static str,
) -> Result<Vec<String>, DatasetError> {
    if !folder.is_dir() {
        let found = if folder.exists() { "a file" } else { "nothing" };
        return Err(DatasetError::NotAFolder {
            path: folder.to_owned(),
            expected,
            found,
        });
    }
    let failed = |source| DatasetError::Read {
        path: folder.to_owned(),
        source,
    };
    let mut stems = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let matches = path.extension().is_some_and(|e| e == extension) && path.is_file();
        if let (true, Some(stem)) = (matches, path.file_stem().and_then(|stem| stem.to_str())) {
            stems.push(stem.to_owned());
        }
    }
    if stems.is_empty() {
        return Err(DatasetError::Empty {
            path: folder.to_owned(),
            expected,
        });
    }
    stems.sort();
    Ok(stems)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(root: &Path, name: &str, content: &str) {
        let path = root.join(name);
        std::fs::create_dir_all(path.parent().expect("a parent")).expect("a folder");
        std::fs::write(path, content).expect("written");
    }

    #[test]
    fn frames_come_in_order_from_velodyne_or_the_folder_itself() {
        let folder = tempfile::tempdir().expect("a folder");
        for name in [
            "b/000002.bin",
            "b/000001.bin",
            "b/notes.md",
            "a/velodyne/7.bin",
        ] {
            write(folder.path(), name, "");
        }
        assert_eq!(
            Dataset::open(&folder.path().join("b"))
                .expect("scans")
                .names(),
            ["000001", "000002"]
        );
        let a = Dataset::open(&folder.path().join("a")).expect("scans");
        assert_eq!(a.scan_path("7"), folder.path().join("a/velodyne/7.bin"));
        assert!(a.scan("7").expect("a scan").is_empty());
    }

    #[test]
    fn splits_name_frames_that_exist() {
        let folder = tempfile::tempdir().expect("a folder");
        for (name, content) in [
            ("velodyne/1.bin", ""),
            ("velodyne/2.bin", ""),
            ("ImageSets/val.txt", "2\n"),
            ("ImageSets/bad.txt", "1\n9\n"),
            ("ImageSets/twice.txt", "1\n2\n\n1\n"),
        ] {
            write(folder.path(), name, content);
        }
        assert_eq!(
            Dataset::open_split(folder.path(), "val")
                .expect("a split")
                .names(),
            ["2"]
        );
        let fault = Dataset::open_split(folder.path(), "bad")
            .expect_err("frame 9")
            .to_string();
        assert!(
            fault.contains("bad.txt, line 2") && fault.contains("'9'"),
            "{fault}"
        );
        assert!(Dataset::open_split(folder.path(), "none").is_err());
        let twice = Dataset::open_split(folder.path(), "twice").expect_err("frame 1 again");
        assert!(twice.to_string().contains("twice.txt, line 4"), "{twice}");
    }

    #[test]
    fn missing_and_empty_folders_are_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let empty = Dataset::open(folder.path()).expect_err("empty").to_string();
        assert!(
            empty.ends_with("expected scans (*.bin), found none"),
            "{empty}"
        );
        let missing = Dataset::open(&folder.path().join("x"))
            .expect_err("missing")
            .to_string();
        assert!(
            missing.ends_with("expected a folder of scans (*.bin), found nothing"),
            "{missing}"
        );
    }

    #[test]
    fn labels_come_as_boxes_of_the_sensor() {
        let folder = tempfile::tempdir().expect("a folder");
        write(folder.path(), "velodyne/0.bin", "");
        write(
            folder.path(),
            "label_2/0.txt",
            "DontCare -1 -1 -10 0 0 9 9 -1 -1 -1 -1000 -1000 -1000 -10\nCar 0 0 0 0 0 100 100 1.5 1.6 4 -2 1.7 20 -1.5708\n",
        );
        write(
            folder.path(),
            "calib/0.txt",
            "P2: 0 0 0 0 0 0 0 0 0 0 0 0\nR0_rect: 1 0 0 0 1 0 0 0 1\nTr_velo_to_cam: 0 -1 0 0 0 0 -1 0 1 0 0 0\n",
        );
        let boxes = Dataset::open(folder.path())
            .expect("frames")
            .boxes_in_sensor("0")
            .expect("boxes");
        assert_eq!(boxes.len(), 1);
        assert_eq!(boxes[0].1.center_m, [20.0, 2.0, -0.95]);
    }
}
