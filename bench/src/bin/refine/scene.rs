//! Frames of a data set with their labelled objects, and simulated proposals: up to a metre off, with a wrong class's size.

use anyhow::Result;
use mluc_dataset::Dataset;
use mluc_geometry::{Box3, Random};
use mluc_ipc_types::{Detection, DetectionKind};
use std::f64::consts::TAU;

/// Objects with fewer points inside their box are not judged.
pub(crate) const POINTS_MIN: usize = 10;
/// Anchor sizes of the known classes: length, width, height, m (the public SECOND configuration for KITTI).
const KNOWN: [(&str, [f64; 3]); 3] =
    [("car", [3.9, 1.6, 1.56]), ("pedestrian", [0.8, 0.6, 1.73]), ("cyclist", [1.76, 0.6, 1.73])];
/// Largest horizontal error, m.
const SHIFT_MAX_M: f64 = 1.0;
/// Largest error of the bottom, m.
const BOTTOM_SHIFT_MAX_M: f64 = 0.2;

pub(crate) struct Object {
    /// Counts the frame's labels with enough points, of any class.
    pub(crate) number: u64,
    /// As in the label file.
    pub(crate) class: String,
    pub(crate) shape: Box3,
}

pub(crate) struct Frame {
    /// Counts the folder's frames.
    pub(crate) number: u64,
    pub(crate) points: Vec<[f32; 4]>,
    pub(crate) objects: Vec<Object>,
}

/// Reads all frames; of the objects those of some classes, or all when none is named. The selection does not change an object's proposals.
pub(crate) fn read(dataset: &Dataset, classes: &[String]) -> Result<Vec<Frame>> {
    let is_wanted = |object: &Object| {
        let mut wanted = classes.iter();
        classes.is_empty() || wanted.any(|class| class.eq_ignore_ascii_case(&object.class))
    };
    let read = |(name, number): (&String, u64)| {
        let points = dataset.scan(name)?;
        let mut labels = dataset.boxes_in_sensor(name)?;
        labels.retain(|(_, shape)| shape.count_inside(&points) >= POINTS_MIN);
        let objects = labels.into_iter().zip(0..);
        let objects =
            objects.map(|((label, shape), number)| Object { number, class: label.class, shape });
        let objects = objects.filter(is_wanted).collect();
        Ok(Frame { number, points, objects })
    };
    dataset.names().iter().zip(0..).map(read).collect()
}

/// A stream of its own for each key; the recorded figures are of these.
fn keyed(keys: [u64; 3]) -> Random {
    let step = |state: u64, key: u64| {
        (state ^ key.wrapping_mul(0x2545_f491_4f6c_dd1d)).wrapping_add(0x9e37_79b9_7f4a_7c15)
    };
    Random::from_state(keys.into_iter().fold(0x6d6c_7563, step))
}

/// A candidate at an object, with the objectness, score and EDS of an ordinary one: centre within a disc of 1 m, any heading, not its class's size.
pub(crate) fn candidate(object: &Object, keys: [u64; 3], eds: f32) -> Detection {
    let mut random = keyed(keys);
    let wrong = KNOWN.iter().filter(|(name, _)| !name.eq_ignore_ascii_case(&object.class));
    let wrong: Vec<[f64; 3]> = wrong.map(|(_, size_m)| *size_m).collect();
    let size_m = wrong[random.below(wrong.len())];
    let distance_m = SHIFT_MAX_M * random.unit().sqrt();
    let (sin, cos) = (TAU * random.unit()).sin_cos();
    let [x, y, z] = object.shape.center_m;
    let shift_m = BOTTOM_SHIFT_MAX_M * (2.0 * random.unit() - 1.0);
    let bottom_m = z - object.shape.size_m[2] / 2.0 + shift_m;
    let center_m = [x + distance_m * cos, y + distance_m * sin, bottom_m + size_m[2] / 2.0];
    Detection {
        center_m: center_m.map(|value| value as f32),
        size_m: size_m.map(|value| value as f32),
        yaw_rad: (TAU * (random.unit() - 0.5)) as f32,
        kind: DetectionKind::Candidate as u32,
        objectness: 0.5,
        score: 0.3,
        eds,
        ..Detection::default()
    }
}
