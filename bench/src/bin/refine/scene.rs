//! Frames of a data set with their labelled objects, and the HDL-64E that recorded them.

use anyhow::{Context, Result};
use mluc_dataset::Dataset;
use mluc_geometry::Box3;
use mluc_ipc_types::Point;
use mluc_refiner::{BeamTable, Sensor};
use mluc_train::hdl_64e;

use crate::proposals::CLASSES;

/// Objects with fewer points inside their box are not judged.
const POINTS_MIN: usize = 10;

/// One labelled object.
pub(crate) struct Object {
    /// Counts the frame's labels with enough points, whatever their class.
    pub(crate) number: usize,
    /// As in the label file.
    pub(crate) class: String,
    /// In the sensor frame.
    pub(crate) shape: Box3,
}

/// One frame.
pub(crate) struct Frame {
    /// Counts the folder's frames.
    pub(crate) number: usize,
    /// Of the scan's file, without its ending.
    pub(crate) name: String,
    /// The scan.
    pub(crate) points: Vec<Point>,
    /// Those with enough points.
    pub(crate) objects: Vec<Object>,
}

/// Reads a folder (velodyne, label_2, calib): one frame in `every`; of the objects those of some classes, or all when
/// none is named. Objects keep their proposals whatever is selected.
pub(crate) fn read(dataset: &Dataset, classes: &[String], every: usize) -> Result<Vec<Frame>> {
    let is_wanted = |class: &str| {
        classes.is_empty()
            || classes
                .iter()
                .any(|wanted| wanted.eq_ignore_ascii_case(class))
    };
    let frame = |number: usize, name: &String| -> Result<Frame> {
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
            .filter(|(_, shape)| inside(&points, shape).count() >= POINTS_MIN)
            .enumerate()
            .filter(|(_, (label, _))| is_wanted(&label.class))
            .map(|(number, (label, shape))| Object {
                number,
                class: label.class,
                shape,
            })
            .collect();
        Ok(Frame {
            number,
            name: name.clone(),
            points,
            objects,
        })
    };
    let names = dataset.names().iter().enumerate().step_by(every.max(1));
    names
        .map(|(number, name)| frame(number, name).with_context(|| format!("frame {name}")))
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
