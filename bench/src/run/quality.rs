//! How good the boxes are, where there are labels: by this a swapped refiner is judged, besides its latency.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Result;
use mluc_dataset::{read_calibration, read_labels};
use mluc_geometry::{Box3, Calibration, iou_3d};
use mluc_ipc_types::{Object, ObjectKind};
use serde_json::{Value, json};

use crate::inputs::box_of;

/// Where labels lie, in KITTI's layout (`label_2/NAME.txt`, `calib/NAME.txt`); `None`: there are none.
pub(crate) struct Labels(Option<PathBuf>);

/// Class and box in the sensor frame.
type Label = (String, Box3);

impl Labels {
    /// `input`: a folder with `velodyne/`, that folder itself, or a scan in it.
    pub(crate) fn near(input: &Path) -> Labels {
        let mut folders = input.ancestors().take(3);
        let root = folders.find(|folder| folder.join("label_2").is_dir());
        Labels(root.map(Path::to_path_buf))
    }

    /// Of a frame; `None`: it has no labels.
    fn of(&self, frame: &str) -> Result<Option<Vec<Label>>> {
        let file = |folder: &str| {
            let path = self.0.as_ref()?.join(format!("{folder}/{frame}.txt"));
            Some(path).filter(|path| path.exists())
        };
        let Some(path) = file("label_2") else {
            return Ok(None);
        };
        let calibration = file("calib").map(|path| read_calibration(&path));
        let calibration = calibration.unwrap_or_else(|| Ok(Calibration::without_camera()))?;
        let labels = read_labels(&path)?.into_iter();
        let labels = labels.filter(|label| !label.is_dont_care()).map(|label| {
            let box_in_sensor = calibration.box_in_sensor_from_label(&label.camera_box);
            (label.class, box_in_sensor)
        });
        Ok(Some(labels.collect()))
    }
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Boxes {
    known: Vec<Box3>,
    unknown: Vec<Box3>,
}

impl Boxes {
    pub(crate) fn of(objects: &[Object]) -> Boxes {
        let is_unknown = |object: &&Object| object.kind == ObjectKind::Unknown as u32;
        let published = objects.iter().filter(|object| object.is_published());
        let (unknown, known): (Vec<&Object>, Vec<&Object>) = published.partition(is_unknown);
        Boxes {
            known: known.into_iter().map(box_of).collect(),
            unknown: unknown.into_iter().map(box_of).collect(),
        }
    }
}

/// What is shown of [`judge`]'s answer: a name and a figure with so many digits; a second figure stands behind a stroke.
const SHOWN: [(&str, &str, usize); 7] = [
    ("labelled frames", "frames", 0),
    (
        "labels of unknown classes: found / all",
        "found/labels_unknown",
        0,
    ),
    ("  3-D overlap of the found ones, mean", "mean_iou_found", 3),
    ("  share of all above 0.3", "share_above_0_3", 2),
    ("  share of all above 0.5", "share_above_0_5", 2),
    (
        "all labels: 3-D overlap of the best box, mean",
        "mean_iou_all",
        3,
    ),
    ("unknown objects a frame", "unknown_per_frame", 1),
];

/// Names and figures of one judgement for a table.
pub(crate) fn shown(quality: &Value) -> [(&'static str, String); 7] {
    SHOWN.map(|(name, keys, digits)| {
        let figures = keys
            .split('/')
            .map(|key| quality[key].as_f64().unwrap_or(0.0));
        let texts: Vec<String> = figures.map(|figure| format!("{figure:.digits$}")).collect();
        (name, texts.join(" / "))
    })
}

/// A label is covered from here on.
const FOUND_MIN: f64 = 0.1;

/// Judges frames by their names, over all with labels; `None` without any. `known`: names of the model's classes. A label's overlap
/// is that of the published box that fits it best, 3-D; of an unknown class that of an unknown object's box.
pub(crate) fn judge(
    frames: &BTreeMap<String, Boxes>,
    labels: &Labels,
    known: &[String],
) -> Result<Option<Value>> {
    let mut judged = Vec::new();
    for (name, boxes) in frames {
        judged.extend(labels.of(name)?.map(|labels| (labels, boxes)));
    }
    Ok((!judged.is_empty()).then(|| quality(&judged, known)))
}

fn quality(frames: &[(Vec<Label>, &Boxes)], known: &[String]) -> Value {
    let best = |label: &Box3, boxes: &[Box3]| {
        let overlaps = boxes.iter().map(|found| iou_3d(found, label));
        overlaps.fold(0.0, f64::max)
    };
    let (mut unknown, mut all) = (Vec::new(), Vec::new());
    for (labels, boxes) in frames {
        for (class, label) in labels {
            let by_unknown = best(label, &boxes.unknown);
            all.push(best(label, &boxes.known).max(by_unknown));
            if !known.iter().any(|name| name.eq_ignore_ascii_case(class)) {
                unknown.push(by_unknown);
            }
        }
    }
    let over = |sum: f64, count: usize| sum / count.max(1) as f64;
    let mean = |values: &[f64]| over(values.iter().sum(), values.len());
    let above = |least: f64| {
        let count = unknown.iter().filter(|&&iou| iou > least).count();
        over(count as f64, unknown.len())
    };
    let found = unknown.iter().copied().filter(|&iou| iou >= FOUND_MIN);
    let found: Vec<f64> = found.collect();
    let published: usize = frames.iter().map(|(_, boxes)| boxes.unknown.len()).sum();
    json!({
        "frames": frames.len(),
        "labels_unknown": unknown.len(),
        "found": found.len(),
        "mean_iou_found": mean(&found),
        "share_above_0_3": above(0.3),
        "share_above_0_5": above(0.5),
        "mean_iou_all": mean(&all),
        "unknown_per_frame": over(published as f64, frames.len()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(x: f64) -> Box3 {
        Box3::new([x, 0.0, 0.0, 2.0, 2.0, 2.0, 0.0])
    }

    #[test]
    fn overlaps_count_by_label() {
        let label = |class: &str, x: f64| (class.to_string(), cube(x));
        let forklifts = [label("forklift", 0.0), label("forklift", 20.0)];
        let labels = [&forklifts[..], &[label("car", 40.0)]].concat();
        let boxes = Boxes {
            known: vec![cube(40.0)],
            unknown: vec![cube(1.0), cube(60.0)],
        };
        let quality = quality(&[(labels, &boxes)], &["Car".to_string()]);
        let figure = |key: &str| quality[key].as_f64().unwrap();
        assert_eq!(
            ["frames", "labels_unknown", "found"].map(figure),
            [1.0, 2.0, 1.0]
        );
        assert_eq!(
            ["share_above_0_3", "share_above_0_5"].map(figure),
            [0.5, 0.0]
        );
        // Half of one in the other: a third.
        assert!((figure("mean_iou_found") - 1.0 / 3.0).abs() < 1e-6);
        assert!((figure("mean_iou_all") - (1.0 / 3.0 + 1.0) / 3.0).abs() < 1e-6);
        assert_eq!(figure("unknown_per_frame"), 2.0);
        assert_eq!(shown(&quality)[1].1, "1 / 2");
    }

    #[test]
    fn labels_come_into_the_sensor_frame_and_damage_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("label_2")).unwrap();
        let file = folder.path().join("label_2/a.txt");
        let truck = "Truck 0.00 0 -2.7107 0 0 100 100 3.0 2.5 8.0 -20.0 1.5 47.0 0.0";
        let region = truck.replace("Truck", "DontCare");
        std::fs::write(&file, format!("{truck}\n{region}\n")).unwrap();
        let labels = Labels::near(&folder.path().join("velodyne"));
        let found = labels.of("a").unwrap().unwrap();
        assert_eq!((found.len(), found[0].0.as_str()), (1, "Truck"));
        assert_eq!(found[0].1.center_m, [47.0, 20.0, 0.0]);
        assert_eq!(found[0].1.size_m, [8.0, 2.5, 3.0]);
        assert!(labels.of("b").unwrap().is_none() && Labels(None).of("a").unwrap().is_none());
        for damaged in ["Car 1 2".to_string(), truck.replace("47.0", "x")] {
            std::fs::write(&file, damaged).unwrap();
            assert!(labels.of("a").is_err());
        }
    }
}
