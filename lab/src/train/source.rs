//! Labelled scans by number, from a folder or made up by a test.

use mluc_geometry::Box3;

use super::error::TrainError;
use super::scene::{Object, Scene};
use crate::dataset::Dataset;
use crate::made_up::MADE_UP;

/// Where scenes come from.
pub trait Source: Send + Sync {
    /// Scenes there are.
    fn count(&self) -> usize;
    /// One of them, points of its objects counted.
    fn scene(&self, number: usize) -> Result<Scene, TrainError>;
}

/// A KITTI-format folder.
#[derive(Clone, Debug)]
pub struct FolderSource {
    dataset: Dataset,
    classes: Vec<String>,
    takes_made_up: bool,
}

/// A label whose visibility is worse than this teaches nothing new about an object's looks.
const OCCLUDED_MAX: i32 = 2;

impl FolderSource {
    /// `classes`: names of the known ones.
    pub fn new(dataset: Dataset, classes: Vec<String>) -> FolderSource {
        FolderSource {
            dataset,
            classes,
            takes_made_up: false,
        }
    }

    /// Whether objects labelled as made up stand for the unknown; else they are of another kind, whose place is ignored.
    pub fn with_made_up(self, takes_made_up: bool) -> FolderSource {
        FolderSource {
            takes_made_up,
            ..self
        }
    }

    fn class_of(&self, name: &str) -> Option<usize> {
        self.classes
            .iter()
            .position(|class| class.eq_ignore_ascii_case(name))
    }

    /// Class and box of every labelled object of a known class, without its scan.
    pub fn labelled(&self, number: usize) -> Result<Vec<(usize, Box3)>, TrainError> {
        let boxes = self
            .dataset
            .boxes_in_sensor(&self.dataset.names()[number])?;
        Ok(boxes
            .into_iter()
            .filter_map(|(label, b)| Some((self.class_of(&label.class)?, b)))
            .collect())
    }

    /// A scene, and for each object whether it is seen well enough to be pasted elsewhere.
    pub fn scene_with_visibility(&self, number: usize) -> Result<(Scene, Vec<bool>), TrainError> {
        let name = &self.dataset.names()[number];
        let mut visible = vec![];
        let mut objects = vec![];
        for (label, bounds) in self.dataset.boxes_in_sensor(name)? {
            visible.push(label.occluded <= OCCLUDED_MAX);
            objects.push(Object {
                class: self.class_of(&label.class),
                bounds,
                points: 0,
                made_up: self.takes_made_up && label.is(MADE_UP),
            });
        }
        let mut points = self.dataset.scan(name)?;
        points.retain(|p| p.iter().all(|v| v.is_finite()));
        let mut scene = Scene { points, objects };
        scene.count_points();
        Ok((scene, visible))
    }
}

impl Source for FolderSource {
    fn count(&self) -> usize {
        self.dataset.len()
    }

    fn scene(&self, number: usize) -> Result<Scene, TrainError> {
        Ok(self.scene_with_visibility(number)?.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::{ExportOptions, Family, Realism, Split, export};

    #[test]
    fn made_up_objects_stand_for_the_unknown_where_that_is_asked_for() {
        let folder = tempfile::tempdir().expect("a folder");
        let options = ExportOptions {
            family: Family::SimKitti,
            split: Split::Train,
            frames: 2,
            sequence: None,
            seed: 3,
            realism: Realism::FULL,
            made_up: true,
            folder: folder.path().to_owned(),
            threads: 1,
        };
        export(&options, || ()).expect("written");
        let source = || {
            let dataset = Dataset::open(folder.path()).expect("a data set");
            FolderSource::new(dataset, vec!["car".into(), "pedestrian".into()])
        };
        let count = |source: FolderSource| {
            let scenes = (0..2).map(|i| source.scene(i).expect("a scene"));
            let objects: Vec<Object> = scenes.flat_map(|s| s.objects).collect();
            let made_up: Vec<&Object> = objects.iter().filter(|o| o.made_up).collect();
            assert!(made_up.iter().all(|o| o.class.is_none()));
            let none = objects.iter().filter(|o| o.class.is_none()).count();
            (made_up.len(), none)
        };
        let (made_up, none) = count(source().with_made_up(true));
        assert!(made_up > 0 && none >= made_up);
        assert_eq!(count(source()), (0, none));
    }
}
