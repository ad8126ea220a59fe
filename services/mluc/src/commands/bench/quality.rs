//! How good the boxes are, where there are labels: by this a swapped refiner is judged beside its latency.

use std::collections::HashMap;

use mluc_geometry::{Box3, iou_3d};
use mluc_ipc_types::{Object, ObjectKind};
use serde::Serialize;

use super::labels::{Label, Labels};

/// Published objects of a frame.
#[derive(Clone, Debug, Default)]
pub(super) struct Boxes {
    known: Vec<Box3>,
    unknown: Vec<Box3>,
}

impl Boxes {
    pub(super) fn of(objects: &[Object]) -> Boxes {
        let mut boxes = Boxes::default();
        for object in objects.iter().filter(|object| object.is_published()) {
            let box_in_sensor = Box3 {
                center_m: object.center_m.map(f64::from),
                size_m: object.size_m.map(f64::from),
                yaw_rad: f64::from(object.yaw_rad),
            };
            match object.kind == ObjectKind::Unknown as u32 {
                true => boxes.unknown.push(box_in_sensor),
                false => boxes.known.push(box_in_sensor),
            }
        }
        boxes
    }
}

/// Over all frames with labels. A label's overlap is that of the published box that fits it best, 3-D.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(super) struct Quality {
    /// Frames that have labels.
    pub(super) frames: usize,
    /// Labelled objects of classes that the model does not know.
    pub(super) labels_unknown: usize,
    /// Of those, covered by an unknown object's box, by at least 0.1.
    pub(super) found: usize,
    /// Mean overlap of those that were found.
    pub(super) mean_iou_found: f64,
    /// Share of all labels of unknown classes whose overlap is above 0.3.
    pub(super) share_above_0_3: f64,
    /// Above 0.5.
    pub(super) share_above_0_5: f64,
    /// Labelled objects of all classes, any published box: mean best overlap.
    pub(super) mean_iou_all: f64,
    /// Unknown objects published a frame.
    pub(super) unknown_per_frame: f64,
}

/// A label is covered from here on.
const FOUND_MIN: f64 = 0.1;

/// Judges frames by their names; `None` without labels.
pub(super) fn judge(
    frames: &[(String, Boxes)],
    labels: &Labels,
    known: &[String],
) -> anyhow::Result<Option<Quality>> {
    let mut cache: HashMap<&str, Option<Vec<Label>>> = HashMap::new();
    let mut sums = Sums::default();
    for (name, boxes) in frames {
        if !cache.contains_key(name.as_str()) {
            cache.insert(name, labels.of(name)?);
        }
        if let Some(Some(labels)) = cache.get(name.as_str()) {
            sums.add(labels, boxes, known);
        }
    }
    Ok((sums.frames > 0).then(|| sums.quality()))
}

#[derive(Default)]
struct Sums {
    frames: usize,
    unknown: Vec<f64>,
    all: Vec<f64>,
    published_unknown: usize,
}

impl Sums {
    fn add(&mut self, labels: &[Label], boxes: &Boxes, known: &[String]) {
        self.frames += 1;
        self.published_unknown += boxes.unknown.len();
        let best = |label: &Label, boxes: &[Box3]| {
            let overlaps = boxes
                .iter()
                .map(|found| iou_3d(found, &label.box_in_sensor));
            overlaps.fold(0.0, f64::max)
        };
        for label in labels {
            let by_unknown = best(label, &boxes.unknown);
            self.all.push(best(label, &boxes.known).max(by_unknown));
            if !known
                .iter()
                .any(|class| class.eq_ignore_ascii_case(&label.class))
            {
                self.unknown.push(by_unknown);
            }
        }
    }

    fn quality(&self) -> Quality {
        let mean = |values: &mut dyn Iterator<Item = f64>| {
            let (count, sum) = values.fold((0usize, 0.0), |(count, sum), value| {
                (count + 1, sum + value)
            });
            (count, if count > 0 { sum / count as f64 } else { 0.0 })
        };
        let above = |least: f64| {
            let count = self.unknown.iter().filter(|&&iou| iou > least).count();
            count as f64 / self.unknown.len().max(1) as f64
        };
        let (found, mean_iou_found) =
            mean(&mut self.unknown.iter().copied().filter(|&iou| iou >= FOUND_MIN));
        Quality {
            frames: self.frames,
            labels_unknown: self.unknown.len(),
            found,
            mean_iou_found,
            share_above_0_3: above(0.3),
            share_above_0_5: above(0.5),
            mean_iou_all: mean(&mut self.all.iter().copied()).1,
            unknown_per_frame: self.published_unknown as f64 / self.frames.max(1) as f64,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(x: f64) -> Box3 {
        Box3 {
            center_m: [x, 0.0, 0.0],
            size_m: [2.0; 3],
            yaw_rad: 0.0,
        }
    }

    #[test]
    fn overlaps_count_by_label() {
        let label = |class: &str, x: f64| Label {
            class: class.to_string(),
            box_in_sensor: cube(x),
        };
        let labels = [
            label("forklift", 0.0),
            label("forklift", 20.0),
            label("car", 40.0),
        ];
        let boxes = Boxes {
            known: vec![cube(40.0)],
            unknown: vec![cube(1.0), cube(60.0)],
        };
        let mut sums = Sums::default();
        sums.add(&labels, &boxes, &["Car".to_string()]);
        let quality = sums.quality();
        assert_eq!(
            (quality.frames, quality.labels_unknown, quality.found),
            (1, 2, 1)
        );
        // Half of one in the other: a third.
        assert!(
            (quality.mean_iou_found - 1.0 / 3.0).abs() < 1e-6,
            "{quality:?}"
        );
        assert_eq!(
            (quality.share_above_0_3, quality.share_above_0_5),
            (0.5, 0.0)
        );
        assert!((quality.mean_iou_all - (1.0 / 3.0 + 1.0) / 3.0).abs() < 1e-6);
        assert_eq!(quality.unknown_per_frame, 2.0);
    }
}
