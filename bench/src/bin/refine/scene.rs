//! Frames of a data set with their labelled objects, and the HDL-64E that recorded them.

use anyhow::{Context, Result};
use mluc_geometry::Box3;
use mluc_ipc_types::Point;
use mluc_lab::dataset::Dataset;
use mluc_lab::train::hdl_64e;
use mluc_refiner::{BeamTable, Sensor};

use crate::proposals::CLASSES;

/// Objects with fewer points inside their box are not judged.
const POINTS_MIN: usize = 10;

/// One labelled object.
pub(crate) struct Object {
    /// As in the label file.
    pub(crate) class: String,
    /// In the sensor frame.
    pub(crate) shape: Box3,
}

/// One frame.
pub(crate) struct Frame {
    /// The scan.
    pub(crate) points: Vec<Point>,
    /// Those with enough points.
    pub(crate) objects: Vec<Object>,
}

/// Reads a whole folder (velodyne, label_2, calib).
pub(crate) fn read(dataset: &Dataset) -> Result<Vec<Frame>> {
    let frame = |name: &String| -> Result<Frame> {
        let points: Vec<Point> = dataset
            .scan(name)?
            .into_iter()
            .map(|[x_m, y_m, z_m, intensity]| Point {
                x_m,
                y_m,
                z_m,
                intensity,
            })
            .collect();
        let objects = dataset
            .boxes_in_sensor(name)?
            .into_iter()
            .map(|(label, shape)| Object {
                class: label.class,
                shape,
            })
            .filter(|object| inside(&points, &object.shape).count() >= POINTS_MIN)
            .collect();
        Ok(Frame { points, objects })
    };
    let name_of = |name: &String| format!("frame {name}");
    dataset
        .names()
        .iter()
        .map(|name| frame(name).with_context(|| name_of(name)))
        .collect()
}

/// Points in a box.
pub(crate) fn inside<'a>(points: &'a [Point], shape: &'a Box3) -> impl Iterator<Item = &'a Point> {
    points
        .iter()
        .filter(|p| shape.contains([p.x_m, p.y_m, p.z_m].map(f64::from)))
}

/// The simulator's HDL-64E on KITTI's car.
pub(crate) fn sensor() -> Sensor {
    let beams = hdl_64e();
    Sensor {
        beams: Some(BeamTable {
            elevation_rad: beams.elevation_rad,
            azimuth_step_rad: beams.azimuth_step_rad,
        }),
        sees_all_around: false,
        ..Sensor::plain(&CLASSES)
    }
}
