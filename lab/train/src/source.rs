//! Labelled scans by number, from a folder in KITTI's format.

use crate::error::TrainError;
use crate::scan::{LabelledObject, LabelledScan};
use mluc_dataset::{Dataset, Label, SYNTHETIC_UNKNOWN};
use mluc_geometry::Box3;
use mluc_model::VoxelInput;

/// Maximum occlusion level of a label that is pasted: a less visible object shows little of its shape.
const OCCLUDED_MAX: i32 = 2;

/// Whether a label represents the unknown: a synthetic unknown object, or a common class (car, pedestrian, cyclist) that the network does not learn.
pub(crate) fn stands_for_unknown(label: &Label, classes: &[String]) -> bool {
    let usual = ["car", "pedestrian", "cyclist"].into_iter();
    let mut unlearned = usual.filter(|usual| !classes.iter().any(|class| class == usual));
    label.is(SYNTHETIC_UNKNOWN) || unlearned.any(|class| label.is(class))
}

/// A folder, and the rule for its labels in training.
#[derive(Clone, Debug)]
pub struct ScanSource {
    /// The folder.
    pub dataset: Dataset,
    /// Names of the known classes.
    pub classes: Vec<String>,
    /// Whether objects labelled as synthetic unknown represent the unknown; otherwise their place is ignored.
    pub takes_synthetic_unknown: bool,
    /// How points and boxes are measured.
    pub input: VoxelInput,
}

impl ScanSource {
    fn class_of(&self, name: &str) -> Option<usize> {
        self.classes.iter().position(|class| class.eq_ignore_ascii_case(name))
    }

    /// Number of scans.
    pub fn count(&self) -> usize {
        self.dataset.names().len()
    }

    /// One scan, with the number of points of each object.
    pub fn scan(&self, number: usize) -> Result<LabelledScan, TrainError> {
        Ok(self.changed(number, |_| ())?.0)
    }

    /// A scan whose raw points `change` has modified, and for each object whether it is visible enough to be pasted elsewhere.
    pub fn changed(
        &self,
        number: usize,
        change: impl FnOnce(&mut Vec<[f32; 4]>),
    ) -> Result<(LabelledScan, Vec<bool>), TrainError> {
        let name = &self.dataset.names()[number];
        let mut visible = vec![];
        let mut scan = LabelledScan::default();
        for (label, bounds) in self.dataset.boxes_in_sensor(name)? {
            visible.push(label.occluded <= OCCLUDED_MAX);
            scan.objects.push(LabelledObject {
                class: self.class_of(&label.class),
                bounds,
                points: 0,
                synthetic_unknown: self.takes_synthetic_unknown
                    && stands_for_unknown(&label, &self.classes),
            });
        }
        scan.points = self.dataset.scan(name)?;
        scan.points.retain(|p| p.iter().all(|v| v.is_finite()));
        change(&mut scan.points);
        if self.input == VoxelInput::Local {
            scan.measure_from_ground();
        }
        scan.count_points();
        Ok((scan, visible))
    }

    /// Class and box of every labelled object of a known class; the scan is not read.
    pub fn labelled(&self, number: usize) -> Result<Vec<(usize, Box3)>, TrainError> {
        let name = &self.dataset.names()[number];
        let boxes = self.dataset.boxes_in_sensor(name)?.into_iter();
        let known = boxes.filter_map(|(label, b)| Some((self.class_of(&label.class)?, b)));
        Ok(known.collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_simulate::{ExportOptions, Family, Split, export};

    #[test]
    fn synthetic_unknown_objects_stand_for_the_unknown_where_that_is_asked_for() {
        let folder = tempfile::tempdir().expect("a folder");
        let root = folder.path().to_owned();
        let mut options = ExportOptions::new(Family::SimKitti, Split::Train, 2, 3, root);
        options.synthetic_unknown = true;
        export(&options, || ()).expect("written");
        // Number of synthetic unknown objects, and number of objects of no class.
        let count = |takes_synthetic_unknown: bool| {
            let source = ScanSource {
                dataset: Dataset::open(folder.path()).expect("a data set"),
                classes: vec!["car".into(), "pedestrian".into()],
                takes_synthetic_unknown,
                input: VoxelInput::Absolute,
            };
            let scans = (0..2).map(|i| source.scan(i).expect("a scan"));
            let objects: Vec<LabelledObject> = scans.flat_map(|s| s.objects).collect();
            let synthetic = objects.iter().filter(|o| o.synthetic_unknown);
            assert!(synthetic.clone().all(|o| o.class.is_none()));
            let without_class = objects.iter().filter(|o| o.class.is_none());
            (synthetic.count(), without_class.count())
        };
        let (synthetic, without_class) = count(true);
        assert!(synthetic > 0 && without_class >= synthetic);
        assert_eq!(count(false), (0, without_class));
    }
}
