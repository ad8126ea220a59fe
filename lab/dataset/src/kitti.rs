//! What is special about KITTI's object benchmark: its folders, its splits, its classes.

use super::scan::check_scan_size;
use super::{Dataset, DatasetError, read_text};
use std::path::{Path, PathBuf};

/// Every class that KITTI's labels name.
pub const KITTI_CLASSES: [&str; 9] = [
    "Car",
    "Van",
    "Truck",
    "Pedestrian",
    "Person_sitting",
    "Cyclist",
    "Tram",
    "Misc",
    "DontCare",
];

/// Class of synthetic unknown objects in label files.
pub const SYNTHETIC_UNKNOWN: &str = "Synthetic_unknown";

/// Classes that simulated scans name beside KITTI's: those that the network is never trained on, and objects made up of known ones.
pub const SIMULATED_CLASSES: [&str; 3] = ["Golf_cart", "Forklift", SYNTHETIC_UNKNOWN];

/// Whether a class is one of KITTI's or the simulator's, whatever the case of its letters.
pub fn is_heard_of(class: &str) -> bool {
    let mut all = KITTI_CLASSES.iter().chain(&SIMULATED_CLASSES);
    all.any(|known| known.eq_ignore_ascii_case(class))
}

/// Where a benchmark folder's splits are listed.
#[derive(Clone, Debug, PartialEq)]
pub struct Splits {
    /// The folder with `training`, or `training` itself.
    pub root: PathBuf,
    /// Folder with `train.txt` and `val.txt`; `None`: `ImageSets` in the root, beside it or in `training`.
    pub folder: Option<PathBuf>,
}

impl Splits {
    /// The folder that holds `velodyne`, `label_2` and `calib`.
    pub fn frames_root(&self) -> PathBuf {
        let inner = self.root.join("training");
        if inner.is_dir() {
            inner
        } else {
            self.root.clone()
        }
    }

    /// Frames of a split, in the order of its list.
    pub fn open(&self, split: &str) -> Result<Dataset, DatasetError> {
        let root = self.frames_root();
        let places: Vec<PathBuf> = match &self.folder {
            Some(folder) => vec![folder.clone()],
            None => {
                let mut places = vec![self.root.join("ImageSets"), root.join("ImageSets")];
                places.extend(self.root.parent().map(|parent| parent.join("ImageSets")));
                places.dedup();
                places
            }
        };
        let list = places
            .iter()
            .map(|place| place.join(format!("{split}.txt")))
            .find(|list| list.is_file());
        match list {
            Some(list) => Dataset::open_listed(&root, &list),
            None => {
                // The scans come first: a folder that is none at all is told as such.
                Dataset::open(&root)?;
                let looked: Vec<String> = places.iter().map(|p| p.display().to_string()).collect();
                Err(DatasetError::NoSplit {
                    split: split.to_owned(),
                    looked: looked.join(", "),
                })
            }
        }
    }
}

/// Checks that every frame has its label and calibration file, and a scan of whole points.
pub fn check_files(dataset: &Dataset) -> Result<(), DatasetError> {
    for name in dataset.names() {
        let files = [
            ("labels", dataset.label_path(name)),
            ("calibration", dataset.calibration_path(name)),
        ];
        for (what, path) in files {
            if !path.is_file() {
                let frame = name.clone();
                return Err(DatasetError::MissingFile { frame, what, path });
            }
        }
        check_scan_size(&dataset.scan_path(name))?;
    }
    Ok(())
}

/// Checks that a label file names classes alone that are heard of: objects of a misspelt one would be left out without a word.
pub fn check_classes<C: AsRef<str>>(path: &Path, heard: &[C]) -> Result<(), DatasetError> {
    for (index, line) in read_text(path)?.lines().enumerate() {
        let Some(class) = line.split_whitespace().next() else {
            continue;
        };
        let is_class = |known: &C| known.as_ref().eq_ignore_ascii_case(class);
        if !heard.iter().any(is_class) {
            let names: Vec<&str> = heard.iter().map(C::as_ref).collect();
            return Err(DatasetError::Class {
                path: path.to_owned(),
                line: index + 1,
                expected: format!("one of {}", names.join(", ")),
                found: class.chars().take(40).collect(),
            });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder() -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("a folder");
        for name in ["velodyne", "label_2", "calib"] {
            std::fs::create_dir_all(folder.path().join("training").join(name)).expect("a folder");
        }
        for name in ["1", "2"] {
            let scan = folder.path().join(format!("training/velodyne/{name}.bin"));
            std::fs::write(scan, []).expect("written");
        }
        folder
    }

    #[test]
    fn lists_are_found_in_the_usual_places_or_where_they_are_said_to_be() {
        let folder = folder();
        let splits = Splits {
            root: folder.path().to_owned(),
            folder: None,
        };
        let fault = splits.open("train").expect_err("no list").to_string();
        assert!(
            fault.starts_with("split train: expected the list of its frames, train.txt, in "),
            "{fault}"
        );
        assert!(fault.contains("ImageSets"), "{fault}");
        let elsewhere = folder.path().join("lists");
        std::fs::create_dir(&elsewhere).expect("a folder");
        std::fs::write(elsewhere.join("train.txt"), "2\n").expect("written");
        let told = Splits {
            folder: Some(elsewhere),
            ..splits.clone()
        };
        assert_eq!(told.open("train").expect("a split").names(), ["2"]);
        std::fs::create_dir(folder.path().join("ImageSets")).expect("a folder");
        std::fs::write(folder.path().join("ImageSets/train.txt"), "1\n2\n").expect("written");
        assert_eq!(splits.open("train").expect("a split").len(), 2);
        let inner = Splits {
            root: folder.path().join("training"),
            folder: None,
        };
        assert_eq!(inner.open("train").expect("beside it").len(), 2);
    }

    #[test]
    fn missing_files_and_unheard_classes_are_named() {
        let folder = folder();
        let root = folder.path().join("training");
        let labels = root.join("label_2/1.txt");
        std::fs::write(&labels, "Car 0\n\nCarr 0\n").expect("written");
        let dataset = Dataset::open(&root).expect("scans");
        let fault = check_files(&dataset)
            .expect_err("no calibration")
            .to_string();
        assert!(
            fault.contains("frame 1: expected its calibration in ") && fault.contains("1.txt"),
            "{fault}"
        );
        let fault = check_classes(&labels, &KITTI_CLASSES)
            .expect_err("a class")
            .to_string();
        assert!(fault.ends_with("line 3, field type: expected one of Car, Van, Truck, Pedestrian, Person_sitting, Cyclist, Tram, Misc, DontCare, found 'Carr'"), "{fault}");
    }
}
