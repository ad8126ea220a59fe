//! A box around a cluster: rectangle seen from above, then height and the parts that the sensor cannot see.
//!
//! A box along the axes is the least ambiguous reading of the paper's "tight box". On an L of points, which is what a sensor
//! sees of a car, the rectangle of least area often does not have the car's heading.

mod closeness;
mod extend;
mod footprint;

pub use closeness::Closeness;
pub use extend::Extend;
pub use footprint::Footprint;

use crate::{Sensor, Settings, Variant};
use mluc_geometry::Box3;
use mluc_kernels::at_best;
use smart_default::SmartDefault;

/// Fits boxes as a variant requires; owns the buffers.
#[derive(Debug)]
pub(crate) struct Fitter {
    /// Whether boxes lie along x and y; if not, they have the heading at which the points are closest to the sides (Zhang et al., 2017).
    is_axis_aligned: bool,
    extend: Extend,
    closeness: Closeness,
    /// The points around which the box is fitted.
    pub(crate) points: ClusterPoints,
}

impl Fitter {
    pub(crate) fn new(settings: &Settings, sensor: &Sensor) -> Fitter {
        Fitter {
            is_axis_aligned: settings.variant == Variant::Paper,
            extend: Extend::of(settings, sensor),
            closeness: Closeness::default(),
            points: ClusterPoints::default(),
        }
    }

    /// The box around the points, on this ground, and their tight rectangle.
    pub(crate) fn fit(&mut self, ground_m: &[f32]) -> (Box3, Rectangle) {
        let tight = if self.is_axis_aligned {
            self.points.rectangle(0.0)
        } else {
            self.closeness.fit(&self.points)
        };
        // Only a cluster without points has no box.
        let shape = self.extend.box_around(&self.points, &tight, ground_m);
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

/// Points of one cluster, in columns: x and y relative to an origin near them, z in the sensor frame, m. By default none.
#[derive(Debug, SmartDefault)]
pub struct ClusterPoints {
    /// x, m.
    pub x_m: Vec<f32>,
    /// y, m.
    pub y_m: Vec<f32>,
    /// z, m.
    pub z_m: Vec<f32>,
    /// Origin in the sensor frame, m.
    pub(crate) origin_m: [f64; 2],
    /// Direction from which headings are counted, rad from x.
    pub(crate) ahead_rad: f64,
    /// The same direction as cosine and sine.
    #[default([1.0, 0.0])]
    ahead: [f32; 2],
}

impl ClusterPoints {
    /// Removes all points; new ones are relative to an origin in the sensor frame, m. Headings are counted from the sensor's line
    /// of sight to it, so that a turn of the scene only turns the boxes.
    pub fn start(&mut self, origin_m: [f64; 2]) {
        self.clear();
        self.origin_m = origin_m;
        self.ahead_rad = origin_m[1].atan2(origin_m[0]);
        let (sin, cos) = self.ahead_rad.sin_cos();
        self.ahead = [cos as f32, sin as f32];
    }

    /// Removes all points.
    pub fn clear(&mut self) {
        self.x_m.clear();
        self.y_m.clear();
        self.z_m.clear();
    }

    /// Adds a point.
    pub fn push(&mut self, x_m: f32, y_m: f32, z_m: f32) {
        self.x_m.push(x_m);
        self.y_m.push(y_m);
        self.z_m.push(z_m);
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.x_m.len()
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.x_m.is_empty()
    }

    /// Lowest and highest z, m; `None` without points.
    pub fn z_range_m(&self) -> Option<[f32; 2]> {
        (!self.is_empty()).then(|| best_span(&self.z_m, &self.z_m, [1.0, 0.0]))
    }

    /// Lowest and highest coordinate along a direction, m.
    pub fn span_m(&self, direction: [f32; 2]) -> [f32; 2] {
        best_span(&self.x_m, &self.y_m, direction)
    }

    /// Lowest and highest coordinate along a direction and along the direction a quarter turn further, m.
    pub fn spans_m(&self, direction: [f32; 2]) -> [[f32; 2]; 2] {
        at_best!(spans(&self.x_m, &self.y_m, direction))
    }

    /// Lengths along and across a direction that is counted from the line of sight, m.
    pub(crate) fn sides_m(&self, [along, aside]: [f32; 2]) -> [f64; 2] {
        let [cos, sin] = self.ahead;
        let direction = [along * cos - aside * sin, along * sin + aside * cos];
        let length = |[low, high]: [f32; 2]| f64::from(high) - f64::from(low);
        self.spans_m(direction).map(length)
    }

    /// The tight rectangle whose first axis points to `yaw_rad`.
    pub fn rectangle(&self, yaw_rad: f64) -> Rectangle {
        let (sin, cos) = (yaw_rad.sin() as f32, yaw_rad.cos() as f32);
        Rectangle { yaw_rad, sides_m: self.spans_m([cos, sin]).map(|span| span.map(f64::from)) }
    }
}

/// A rectangle around the origin of its points: the first axis at `yaw_rad` from x, the second a quarter turn further.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rectangle {
    /// Direction of the first axis, rad from x.
    pub yaw_rad: f64,
    /// Lowest and highest coordinate along each axis, m.
    pub sides_m: [[f64; 2]; 2],
}

impl Rectangle {
    /// Size along each axis, m.
    pub fn size_m(&self) -> [f64; 2] {
        self.sides_m.map(|[low, high]| high - low)
    }

    /// The rectangle with a margin on every side, m.
    pub fn grown(&self, margin_m: f64) -> Rectangle {
        Rectangle {
            sides_m: (self.sides_m).map(|[low, high]| [low - margin_m, high + margin_m]),
            ..*self
        }
    }

    /// Centre relative to the points' origin, m.
    pub fn center_m(&self) -> [f64; 2] {
        let (sin, cos) = self.yaw_rad.sin_cos();
        let [u, v] = self.sides_m.map(|[low, high]| (low + high) / 2.0);
        [u * cos - v * sin, u * sin + v * cos]
    }

    /// Corners relative to the points' origin, counter-clockwise, m.
    fn corners_m(&self) -> [[f64; 2]; 4] {
        let (sin, cos) = self.yaw_rad.sin_cos();
        let [us, vs] = self.sides_m;
        [(1, 1), (0, 1), (0, 0), (1, 0)].map(|(i, k)| {
            let (u, v) = (us[i], vs[k]);
            [u * cos - v * sin, u * sin + v * cos]
        })
    }
}

/// [`span`] with the widest registers of the processor.
fn best_span(x: &[f32], y: &[f32], d: [f32; 2]) -> [f32; 2] {
    at_best!(span(x, y, d))
}

/// Number of lanes of the loops below: enough for the compiler to use vectors.
const LANES: usize = 16;

/// [`span`] along a direction and along the direction a quarter turn further.
#[inline(always)]
pub(crate) fn spans(x: &[f32], y: &[f32], [cos, sin]: [f32; 2]) -> [[f32; 2]; 2] {
    [span(x, y, [cos, sin]), span(x, y, [-sin, cos])]
}

/// Lowest and highest `x * d[0] + y * d[1]`; infinities without points.
#[inline(always)]
fn span(x: &[f32], y: &[f32], d: [f32; 2]) -> [f32; 2] {
    let mut low = [f32::INFINITY; LANES];
    let mut high = [f32::NEG_INFINITY; LANES];
    let (x_blocks, y_blocks) = (x.chunks_exact(LANES), y.chunks_exact(LANES));
    let rest = x_blocks.remainder().iter().zip(y_blocks.remainder());
    for (x, y) in x_blocks.zip(y_blocks) {
        for lane in 0..LANES {
            let t = x[lane] * d[0] + y[lane] * d[1];
            low[lane] = lower(low[lane], t);
            high[lane] = higher(high[lane], t);
        }
    }
    for (lane, (x, y)) in rest.enumerate() {
        let t = x * d[0] + y * d[1];
        low[lane] = lower(low[lane], t);
        high[lane] = higher(high[lane], t);
    }
    let low = low.into_iter().fold(f32::INFINITY, lower);
    [low, high.into_iter().fold(f32::NEG_INFINITY, higher)]
}

// Comparisons instead of `min` and `max`, which handle NaN and cost more.
#[inline(always)]
pub(crate) fn lower(least: f32, t: f32) -> f32 {
    if t < least { t } else { least }
}

#[inline(always)]
pub(crate) fn higher(most: f32, t: f32) -> f32 {
    if t > most { t } else { most }
}
