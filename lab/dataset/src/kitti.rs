//! The parts that are specific to KITTI's object benchmark: its folders, its splits, its classes.

use super::{Dataset, DatasetError, Result, error::Line, read_text, scan::check_scan_size};
use std::path::{Path, PathBuf};

/// Every class in KITTI's labels.
pub const KITTI_CLASSES: [&str; 9] =
    ["Car", "Van", "Truck", "Pedestrian", "Person_sitting", "Cyclist", "Tram", "Misc", "DontCare"];

/// Class of synthetic unknown objects in label files.
pub const SYNTHETIC_UNKNOWN: &str = "Synthetic_unknown";
/// Classes of simulated scans that KITTI does not have: two that the network is never trained on, and synthetic unknown objects.
pub const SIMULATED_CLASSES: [&str; 3] = ["Golf_cart", "Forklift", SYNTHETIC_UNKNOWN];

/// Classes that `simulate --unseen` shows, first of validation, then of test. Training refuses their labels.
pub fn unseen_classes() -> impl Iterator<Item = &'static str> {
    include_str!("unseen.txt").lines()
}

/// Whether a class is one of KITTI's or the simulator's, whatever the case of its letters.
pub fn is_recognized(class: &str) -> bool {
    let known = KITTI_CLASSES.iter().chain(&SIMULATED_CLASSES);
    known.copied().chain(unseen_classes()).any(|known| known.eq_ignore_ascii_case(class))
}

/// Location of the split lists of a benchmark folder.
#[derive(Clone, Debug, PartialEq)]
pub struct Splits {
    /// The folder that contains `training`, or `training` itself.
    pub root: PathBuf,
    /// Folder with `train.txt` and `val.txt`; `None`: `ImageSets` in the root, next to it or in `training`.
    pub folder: Option<PathBuf>,
}

impl Splits {
    /// Frames of a split, in the order of its list.
    pub fn open(&self, split: &str) -> Result<Dataset> {
        let inner = self.root.join("training");
        let root = if inner.is_dir() { &inner } else { &self.root };
        let mut places: Vec<PathBuf> = self.folder.clone().into_iter().collect();
        if places.is_empty() {
            let roots = [Some(&*self.root), Some(root), self.root.parent()];
            let folders = roots.iter().flatten();
            places = folders.map(|root| root.join("ImageSets")).collect();
            places.dedup();
        }
        let mut lists = places.iter().map(|place| place.join(format!("{split}.txt")));
        if let Some(list) = lists.find(|list| list.is_file()) {
            return Dataset::open_listed(root, &list);
        }
        // The scans come first: for a folder that is no data set at all, the error says so.
        Dataset::open(root)?;
        let looked: Vec<String> = places.iter().map(|p| p.display().to_string()).collect();
        let looked = looked.join(", ");
        let place = format!("split {split}");
        let expected = format!("the list of its frames, {split}.txt, in {looked}");
        let found = "none; give the folder that holds it";
        Err(DatasetError::unexpected(place, expected, found))
    }
}

/// Checks that every frame has its label and calibration file, and a scan whose size is a whole number of points.
pub fn check_files(dataset: &Dataset) -> Result<()> {
    for name in dataset.names() {
        let paths = [dataset.label_path(name), dataset.calibration_path(name)];
        for (what, path) in ["labels", "calibration"].into_iter().zip(paths) {
            if !path.is_file() {
                let (place, found) = (format!("frame {name}"), "no such file");
                let expected = format!("its {what} in {}", path.display());
                return Err(DatasetError::unexpected(place, expected, found));
            }
        }
        check_scan_size(&dataset.scan_path(name))?;
    }
    Ok(())
}

/// Checks that a label file names only the classes of `heard`: a misspelt class would otherwise be left out silently.
pub fn check_classes<C: AsRef<str>>(path: &Path, heard: &[C]) -> Result<()> {
    for (index, line) in read_text(path)?.lines().enumerate() {
        let Some(class) = line.split_whitespace().next() else {
            continue;
        };
        let is_class = |known: &C| known.as_ref().eq_ignore_ascii_case(class);
        if !heard.iter().any(is_class) {
            let names: Vec<&str> = heard.iter().map(C::as_ref).collect();
            let expected = format!("one of {}", names.join(", "));
            return Err(Line { path, index }.in_field("type", expected, class));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::folder::tests::folder_of;
    use super::*;

    #[test]
    fn lists_are_found_in_the_usual_places_or_where_they_are_said_to_be() {
        let scans = ["training/velodyne/1.bin", "training/velodyne/2.bin"];
        let [one, two] = scans.map(|name| (name, ""));
        let folder = folder_of(&[one, two, ("lists/train.txt", "2\n")]);
        let open = |root: &str, lists: Option<&str>| {
            let splits = Splits {
                root: folder.path().join(root),
                folder: lists.map(|lists| folder.path().join(lists)),
            };
            splits.open("train")
        };
        let fault = open("", None).expect_err("no list").to_string();
        assert!(fault.contains("train.txt") && fault.contains("ImageSets"), "{fault}");
        assert_eq!(open("", Some("lists")).expect("a split").names(), ["2"]);
        std::fs::create_dir(folder.path().join("ImageSets")).expect("a folder");
        std::fs::write(folder.path().join("ImageSets/train.txt"), "1\n2\n").expect("written");
        assert_eq!(open("", None).expect("a split").names().len(), 2);
        assert_eq!(open("training", None).expect("beside it").names().len(), 2);
    }
}
