//! Reading the statistics off a data set.

use super::Summary;
use mluc_dataset::{Dataset, DatasetError, Label};
use mluc_geometry::Box3;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Ranges are looked at in bins of 10 m, this many of them.
pub const RANGE_BINS: usize = 8;

/// Figures of one class.
#[derive(Clone, Debug, PartialEq)]
pub struct ClassStatistics {
    /// l, w, h, m.
    pub size_m: [Summary; 3],
    /// Distance of the box's centre from the sensor on the ground, m.
    pub range_m: Summary,
    /// z of the box's bottom in the sensor frame, m.
    pub bottom_m: Summary,
    /// Points of the scan in the box, by bins of 10 m of range.
    pub points: [Summary; RANGE_BINS],
    /// Shares of the occlusion levels 0, 1, 2 and of all others.
    pub occluded: [f64; 4],
}

/// Figures of a data set.
#[derive(Clone, Debug, PartialEq)]
pub struct Statistics {
    /// Frames read.
    pub frames: usize,
    /// Points a scan.
    pub points_per_scan: Summary,
    /// Labelled objects a frame.
    pub objects_per_frame: Summary,
    /// By class, in the order of their names.
    pub classes: BTreeMap<String, ClassStatistics>,
}

struct Object {
    class: String,
    box_in_sensor: Box3,
    occluded: i32,
    points: usize,
}

/// Reads every frame of a data set. Labels without a rectangle in the image (objects outside the camera's view) are left out, as KITTI has none such.
pub fn collect(dataset: &Dataset) -> Result<Statistics, DatasetError> {
    let frames: Vec<(usize, Vec<Object>)> = dataset
        .names()
        .par_iter()
        .map(|name| frame(dataset, name))
        .collect::<Result<_, _>>()?;
    let points_per_scan = Summary::new(frames.iter().map(|f| f.0 as f64).collect());
    let objects_per_frame = Summary::new(frames.iter().map(|f| f.1.len() as f64).collect());
    let count = frames.len();
    let mut by_class: BTreeMap<String, Vec<Object>> = BTreeMap::new();
    for object in frames.into_iter().flat_map(|f| f.1) {
        by_class
            .entry(object.class.clone())
            .or_default()
            .push(object);
    }
    let classes = by_class
        .into_iter()
        .map(|(class, objects)| (class, summarise(&objects)))
        .collect();
    Ok(Statistics {
        frames: count,
        points_per_scan,
        objects_per_frame,
        classes,
    })
}

fn frame(dataset: &Dataset, name: &str) -> Result<(usize, Vec<Object>), DatasetError> {
    let points = dataset.scan(name)?;
    let in_view = |label: &Label| {
        let [left, top, right, bottom] = label.image_box_px;
        right > left && bottom > top
    };
    let boxes = dataset.boxes_in_sensor(name)?;
    let objects = boxes
        .into_iter()
        .filter(|(label, _)| in_view(label))
        .map(|(label, b)| Object {
            points: inside(&b, &points),
            class: label.class,
            box_in_sensor: b,
            occluded: label.occluded,
        });
    Ok((points.len(), objects.collect()))
}

fn inside(b: &Box3, points: &[[f32; 4]]) -> usize {
    let reach = b.size_m[0].hypot(b.size_m[1]) / 2.0;
    let near = |p: &&[f32; 4]| (0..2).all(|i| (f64::from(p[i]) - b.center_m[i]).abs() <= reach);
    points
        .iter()
        .filter(near)
        .filter(|p| b.contains([p[0], p[1], p[2]].map(f64::from)))
        .count()
}

fn summarise(objects: &[Object]) -> ClassStatistics {
    let all = |value: &dyn Fn(&Object) -> f64| Summary::new(objects.iter().map(value).collect());
    let range = |o: &Object| o.box_in_sensor.center_m[0].hypot(o.box_in_sensor.center_m[1]);
    let level = |o: &Object| usize::try_from(o.occluded).map_or(3, |v| v.min(3));
    ClassStatistics {
        size_m: std::array::from_fn(|i| all(&|o| o.box_in_sensor.size_m[i])),
        range_m: all(&range),
        bottom_m: all(&|o| o.box_in_sensor.center_m[2] - o.box_in_sensor.size_m[2] / 2.0),
        points: std::array::from_fn(|bin| {
            Summary::new(
                objects
                    .iter()
                    .filter(|o| (range(o) / 10.0) as usize == bin)
                    .map(|o| o.points as f64)
                    .collect(),
            )
        }),
        occluded: std::array::from_fn(|l| {
            objects.iter().filter(|o| level(o) == l).count() as f64 / objects.len().max(1) as f64
        }),
    }
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
        let frames: Vec<_> = (0..2)
            .map(|i| frame(Family::SimUdi, Split::Train, 4, i).expect("a frame"))
            .collect();
        assert_eq!(found.frames, 2);
        let points: usize = frames.iter().map(|f| f.points.len()).sum();
        assert!((found.points_per_scan.mean() - points as f64 / 2.0).abs() < 1e-9);
        let cars: Vec<u32> = frames
            .iter()
            .flat_map(|f| &f.objects)
            .filter(|o| o.class.name() == "Car")
            .map(|o| o.points)
            .collect();
        let figures = &found.classes["Car"];
        assert_eq!(figures.range_m.count(), cars.len());
        let in_boxes: f64 = figures
            .points
            .iter()
            .map(|s| s.mean() * s.count() as f64)
            .sum();
        // The label file rounds to a tenth of a millimetre: a point on the edge may change sides.
        assert!((in_boxes - cars.iter().map(|p| f64::from(*p)).sum::<f64>()).abs() < 5.0);
        let path = root.path().join("reference.json");
        std::fs::write(&path, r#"{"train_split_3712":{"classes":{"Car":{"lwh_mean":[3.9,1.6,1.5],"lwh_std":[0.4,0.1,0.1]}}}}"#).expect("written");
        let text = table(&found, Some(&read_reference(&path).expect("a reference")));
        assert!(
            text.contains("| length, m |") && text.contains("3.90 ± 0.40"),
            "{text}"
        );
        std::fs::write(&path, "{}").expect("written");
        assert!(
            read_reference(&path)
                .expect_err("no classes")
                .to_string()
                .contains("train_split_3712.classes")
        );
    }
}
