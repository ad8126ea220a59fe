//! The box of a variant around a cluster.
//!
//! Along the axes is what the paper's "tight box" says least ambiguously. On an L of points, which is what a sensor sees of a
//! car, the least area is often not the car's heading: it is kept as a reference beside [`super::Closeness`].

use mluc_geometry::Box3;
use serde::{Deserialize, Serialize};

use super::{Closeness, ClusterPoints, Extend, Rectangle};
use crate::{Sensor, Settings};
use mluc_geometry::ground::GroundPlane;

/// How a rectangle is laid around a cluster.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BoxFit {
    /// Sides along x and y.
    AxisAligned,
    /// The rectangle of least area.
    MinimumArea,
    /// The rectangle whose sides the points lie closest to (Zhang et al., 2017).
    #[default]
    Closeness,
}

/// Lays boxes as a variant has it; holds the buffers.
#[derive(Debug)]
pub(crate) struct Fitter {
    fit: BoxFit,
    extend: Extend,
    closeness: Closeness,
    /// What the box is laid around.
    pub(crate) points: ClusterPoints,
}

impl Fitter {
    pub(crate) fn new(settings: &Settings, sensor: &Sensor) -> Fitter {
        Fitter {
            fit: settings.box_fit(),
            extend: Extend::of(settings, sensor),
            closeness: Closeness::default(),
            points: ClusterPoints::default(),
        }
    }

    /// The box around the points, on this ground, and their tight rectangle.
    pub(crate) fn fit(&mut self, ground: &GroundPlane) -> (Box3, Rectangle) {
        let tight = match self.fit {
            BoxFit::AxisAligned => self.points.rectangle(0.0),
            BoxFit::MinimumArea => minimum_area(&self.points),
            BoxFit::Closeness => self.closeness.fit(&self.points),
        };
        // Only a cluster without points has no box.
        let shape = self.extend.box_around(&self.points, &tight, ground);
        (shape.unwrap_or_else(|| Box3::new([0.0; 7])), tight)
    }
}

/// The tight rectangle of least area over headings one degree apart; the first heading wins a tie.
pub fn minimum_area(points: &ClusterPoints) -> Rectangle {
    let area = |r: &Rectangle| r.size_m()[0] * r.size_m()[1];
    let at = |degrees: i32| points.rectangle(points.ahead_rad + f64::from(degrees).to_radians());
    let better = |a: Rectangle, b: Rectangle| if area(&b) < area(&a) { b } else { a };
    (1..90).map(at).fold(at(0), better)
}
