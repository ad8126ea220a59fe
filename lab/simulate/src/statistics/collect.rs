//! Reading the statistics off a data set.

use super::Summary;
use mluc_dataset::{Dataset, DatasetError, Label};
use mluc_geometry::Box3;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// A labelled object and the points of the scan in its box.
pub(super) struct Object {
    pub(super) box_in_sensor: Box3,
    pub(super) occluded: i32,
    pub(super) points: usize,
}

impl Object {
    /// Distance of the box's centre from the sensor on the ground.
    pub(super) fn range_m(&self) -> f64 {
        let [x, y, _] = self.box_in_sensor.center_m;
        x.hypot(y)
    }
}

/// What a data set holds.
pub struct Statistics {
    /// One value a frame each.
    pub(super) points_per_scan: Summary,
    pub(super) objects_per_frame: Summary,
    /// By class, in the order of their names.
    pub(super) classes: BTreeMap<String, Vec<Object>>,
}

/// Reads every frame of a data set. Labels without a rectangle in the image (objects outside the camera's view) are left out, as KITTI has none such.
pub fn collect(dataset: &Dataset) -> Result<Statistics, DatasetError> {
    let frames: Vec<(usize, Vec<(Label, Object)>)> = (dataset.names().par_iter())
        .map(|name| frame(dataset, name))
        .collect::<Result<_, _>>()?;
    let points_per_scan = Summary::new(frames.iter().map(|f| f.0 as f64).collect());
    let objects_per_frame = Summary::new(frames.iter().map(|f| f.1.len() as f64).collect());
    let mut classes: BTreeMap<String, Vec<Object>> = BTreeMap::new();
    for (label, object) in frames.into_iter().flat_map(|f| f.1) {
        classes.entry(label.class).or_default().push(object);
    }
    Ok(Statistics {
        points_per_scan,
        objects_per_frame,
        classes,
    })
}

fn frame(dataset: &Dataset, name: &str) -> Result<(usize, Vec<(Label, Object)>), DatasetError> {
    let points = dataset.scan(name)?;
    let mut boxes = dataset.boxes_in_sensor(name)?;
    boxes.retain(|(label, _)| {
        let [left, top, right, bottom] = label.image_box_px;
        right > left && bottom > top
    });
    let object = |(label, box_in_sensor): (Label, Box3)| {
        let object = Object {
            box_in_sensor,
            occluded: label.occluded,
            points: box_in_sensor.count_inside(&points),
        };
        (label, object)
    };
    Ok((points.len(), boxes.into_iter().map(object).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::{read_reference, table};
    use crate::{ExportOptions, Family, Split, export, frame};

    #[test]
    fn figures_of_two_simulated_frames_beside_a_reference() {
        let root = tempfile::tempdir().expect("a folder");
        let folder = root.path().join("set");
        let options = ExportOptions::new(Family::SimUdi, Split::Train, 2, 4, folder.clone());
        export(&options, || ()).expect("written");
        let found = collect(&Dataset::open(&folder).expect("a data set")).expect("figures");
        let frames = [0, 1].map(|i| frame(Family::SimUdi, Split::Train, 4, i).expect("a frame"));
        assert_eq!(found.points_per_scan.count(), 2);
        let points: usize = frames.iter().map(|f| f.points.len()).sum();
        assert!((found.points_per_scan.mean() - points as f64 / 2.0).abs() < 1e-9);
        let cars = frames
            .iter()
            .flat_map(|f| &f.objects)
            .filter(|o| o.class.name() == "Car");
        let cars: Vec<usize> = cars.map(|o| o.points as usize).collect();
        let objects = &found.classes["Car"];
        assert_eq!(objects.len(), cars.len());
        let in_boxes: usize = objects.iter().map(|o| o.points).sum();
        // The label file rounds to a tenth of a millimetre: a point on the edge may change sides.
        assert!(in_boxes.abs_diff(cars.iter().sum()) < 5);
        let path = root.path().join("reference.json");
        let car = r#"{"lwh_mean":[3.9,1.6,1.5],"lwh_std":[0.4,0.1,0.1]}"#;
        let json = format!(r#"{{"train_split_3712":{{"classes":{{"Car":{car}}}}}}}"#);
        std::fs::write(&path, json).expect("written");
        let text = table(&found, Some(&read_reference(&path).expect("a reference")));
        assert!(text.contains("| length, m |"), "{text}");
        assert!(text.contains("3.90 ± 0.40"), "{text}");
        std::fs::write(&path, "{}").expect("written");
        let fault = read_reference(&path).expect_err("no classes").to_string();
        assert!(fault.contains("train_split_3712.classes"), "{fault}");
    }
}
