//! Frames of a data set with their labelled objects, and proposals as a detector without the object's class would make
//! them: off by up to a metre, of a wrong class's size.

use std::f64::consts::TAU;

use anyhow::{Context, Result};
use mluc_dataset::Dataset;
use mluc_geometry::{Box3, Random};
use mluc_ipc_types::Point;

/// Objects with fewer points inside their box are not judged.
const POINTS_MIN: usize = 10;
/// Anchor sizes of the known classes, l, w, h, m (the public SECOND configuration for KITTI).
const KNOWN: [(&str, [f64; 3]); 3] = [
    ("car", [3.9, 1.6, 1.56]),
    ("pedestrian", [0.8, 0.6, 1.73]),
    ("cyclist", [1.76, 0.6, 1.73]),
];
/// Largest horizontal error, m.
const SHIFT_MAX_M: f64 = 1.0;
/// Largest error of the bottom, m.
const BOTTOM_SHIFT_MAX_M: f64 = 0.2;

pub(crate) struct Object {
    /// Counts the frame's labels with enough points, whatever their class.
    pub(crate) number: usize,
    /// As in the label file.
    pub(crate) class: String,
    pub(crate) shape: Box3,
}

pub(crate) struct Frame {
    /// Counts the folder's frames.
    pub(crate) number: usize,
    pub(crate) points: Vec<Point>,
    /// Those with enough points.
    pub(crate) objects: Vec<Object>,
}

/// Reads a folder (velodyne, label_2, calib); of the objects those of some classes, or all when none is named. Objects keep their proposals whatever is selected.
pub(crate) fn read(dataset: &Dataset, classes: &[String]) -> Result<Vec<Frame>> {
    let names = dataset.names().iter().enumerate();
    let read = |(number, name): (usize, &String)| {
        read_frame(dataset, number, name, classes).with_context(|| format!("frame {name}"))
    };
    names.map(read).collect()
}

fn read_frame(dataset: &Dataset, number: usize, name: &str, classes: &[String]) -> Result<Frame> {
    let points: Vec<Point> = bytemuck::cast_slice(&dataset.scan(name)?).to_vec();
    let mut labels = dataset.boxes_in_sensor(name)?;
    labels.retain(|(_, shape)| inside(&points, shape).count() >= POINTS_MIN);
    let objects = labels.into_iter().enumerate();
    let objects = objects.map(|(number, (label, shape))| Object {
        number,
        class: label.class,
        shape,
    });
    let is_wanted = |object: &Object| {
        let mut wanted = classes.iter();
        classes.is_empty() || wanted.any(|class| class.eq_ignore_ascii_case(&object.class))
    };
    Ok(Frame {
        number,
        objects: objects.filter(is_wanted).collect(),
        points,
    })
}

pub(crate) fn inside<'a>(points: &'a [Point], shape: &'a Box3) -> impl Iterator<Item = &'a Point> {
    let is_inside = |p: &&Point| shape.contains([p.x_m, p.y_m, p.z_m].map(f64::from));
    points.iter().filter(is_inside)
}

/// A stream of its own for each key.
pub(crate) fn keyed(keys: [u64; 3]) -> Random {
    let step = |state: u64, key: u64| {
        (state ^ key.wrapping_mul(0x2545_F491_4F6C_DD1D)).wrapping_add(0x9E37_79B9_7F4A_7C15)
    };
    Random::from_state(keys.into_iter().fold(0x6D6C_7563, step))
}

/// One proposal for an object of a class: centre within a disc of 1 m, any heading, a size that is not its class's.
pub(crate) fn proposal(class: &str, object: &Box3, random: &mut Random) -> Box3 {
    let wrong = KNOWN
        .iter()
        .filter(|(name, _)| !name.eq_ignore_ascii_case(class));
    let wrong: Vec<[f64; 3]> = wrong.map(|&(_, size_m)| size_m).collect();
    let size_m = wrong[random.below(wrong.len())];
    let distance_m = SHIFT_MAX_M * random.unit().sqrt();
    let (sin, cos) = (TAU * random.unit()).sin_cos();
    let [x, y, z] = object.center_m;
    let [x, y] = [x + distance_m * cos, y + distance_m * sin];
    let bottom_m = z - object.size_m[2] / 2.0 + BOTTOM_SHIFT_MAX_M * (2.0 * random.unit() - 1.0);
    Box3 {
        center_m: [x, y, bottom_m + size_m[2] / 2.0],
        size_m,
        yaw_rad: TAU * (random.unit() - 0.5),
    }
}
