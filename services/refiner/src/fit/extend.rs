//! The parts of a box that the sensor does not see: down to the ground, and away from the sensor.

use super::{ClusterPoints, Rectangle};
use crate::{Sensor, Settings, Variant, priors, priors::EndFace};
use mluc_geometry::ground::ground_height_m;
use mluc_geometry::{Box3, limit_period};
use std::f64::consts::{FRAC_PI_2, PI};

/// Minimum size, m: sizes of published boxes are above 0.
const SIZE_MIN_M: f64 = 0.1;
/// Margin that includes the returns of about the topmost two beams, rad: a sensor's beams differ from the table by about 0.1 degrees.
const TOP_MARGIN_RAD: f64 = 0.009;

/// The settings by which a tight rectangle becomes a box.
#[derive(Clone, Copy, Debug)]
pub struct Extend {
    /// Whether the bottom goes down to the ground.
    pub to_ground: bool,
    /// Whether unseen parts are completed, from the known proportions of road vehicles.
    pub completes: bool,
    /// Elevation of the topmost beams, rad, if the sensor's beams are known: returns at least this high are from the topmost beams.
    pub top_rad: Option<f64>,
}

impl Extend {
    pub(crate) fn of(settings: &Settings, sensor: &Sensor) -> Extend {
        let beams = sensor.beams.as_ref();
        let top_rad = beams.and_then(|beams| beams.elevation_rad.first());
        Extend {
            to_ground: settings.variant != Variant::Paper,
            completes: settings.is_ours(),
            top_rad: top_rad.map(|top| f64::from(*top) - TOP_MARGIN_RAD),
        }
    }

    /// The box around a cluster and its tight rectangle, on the ground of a scan ([`ground_height_m`]). `None` without points.
    pub fn box_around(
        &self,
        points: &ClusterPoints,
        tight: &Rectangle,
        ground_m: &[f32],
    ) -> Option<Box3> {
        let floor_m =
            |place_m: [f64; 2]| f64::from(ground_height_m(ground_m, place_m.map(|v| v as f32)));
        let z_m = points.z_range_m()?.map(f64::from);
        let mut r = *tight;
        let seen_m = z_m[1] - floor_m(points.origin_m);
        if self.completes {
            let [u, v] = r.size_m();
            for (axis, other_m) in [v, u].into_iter().enumerate() {
                let least_m = (priors::FAR_SIDE_SHARE * other_m).min(priors::FAR_SIDE_MAX_M);
                grow_away(&mut r, axis, least_m, points.origin_m);
            }
            let mut ends = priors::ENDS.iter().filter(|end| seen_m >= end.height_min_m);
            ends.find(|end| lengthen(end, &mut r, points, z_m));
        }
        let [x, y] = r.center_m();
        let (x, y) = (x + points.origin_m[0], y + points.origin_m[1]);
        let [u, v] = r.size_m();
        let [mut bottom, mut top] = z_m;
        if self.to_ground {
            bottom = bottom.min(floor_m([x, y]));
        }
        if let Some(top_rad) = self.top_rad.filter(|_| self.completes)
            && is_cut(top_rad, [u.max(v), seen_m], points)
        {
            top = top.max(floor_m([x, y]) + priors::CUT_TOP_HEIGHT_M);
        }
        // The longer side is the length.
        let turn_rad = if u >= v { 0.0 } else { FRAC_PI_2 };
        let yaw_rad = limit_period(r.yaw_rad + turn_rad, 0.5, PI);
        let [l, w, h] = [u.max(v), u.min(v), top - bottom].map(|side| side.max(SIZE_MIN_M));
        Some(Box3::new([x, y, (bottom + top) / 2.0, l, w, h, yaw_rad]))
    }
}

/// Whether an object with this completed length and this seen height, m, reaches above the topmost beams.
fn is_cut(top_rad: f64, size_m: [f64; 2], points: &ClusterPoints) -> bool {
    let mut sizes = size_m.iter().zip(priors::CUT_TOP_MIN_M);
    if sizes.any(|(size_m, least_m)| *size_m < least_m) {
        return false;
    }
    let [x, y] = points.origin_m.map(|v| v as f32);
    let tangent = top_rad.tan() as f32;
    let columns = points.x_m.iter().zip(&points.y_m).zip(&points.z_m);
    // Compared without a square root; points below the sensor are not from its topmost beams.
    columns.into_iter().any(|((px, py), &z)| {
        let flat = (px + x) * (px + x) + (py + y) * (py + y);
        z > 0.0 && z * z >= tangent * tangent * flat
    })
}

/// Grows the side along the line of sight if this is such an end; returns whether it is.
fn lengthen(end: &EndFace, r: &mut Rectangle, points: &ClusterPoints, z_m: [f64; 2]) -> bool {
    let [u, v] = [0, 1].map(|axis| sensor_along(r, points.origin_m, axis).abs());
    if u.min(v) > u.max(v) * priors::END_ASIDE_MAX_RAD.tan() {
        return false;
    }
    let (along, across) = if u > v { (0, 1) } else { (1, 0) };
    let width_m = r.size_m()[across];
    let is_end = (end.width_m[0]..=end.width_m[1]).contains(&width_m)
        && top_width_m(r, points, z_m, across) >= priors::END_TOP_SHARE_MIN * width_m;
    if is_end {
        grow_away(r, along, end.share * width_m, points.origin_m);
    }
    is_end
}

/// Extent of the upper third of the points along an axis of the rectangle, m.
fn top_width_m(r: &Rectangle, points: &ClusterPoints, z_m: [f64; 2], axis: usize) -> f64 {
    let (sin, cos) = (r.yaw_rad.sin() as f32, r.yaw_rad.cos() as f32);
    let direction = [[cos, sin], [-sin, cos]][axis];
    let from_m = (z_m[1] - (z_m[1] - z_m[0]) / 3.0) as f32;
    let upper = points.x_m.iter().zip(&points.y_m).zip(&points.z_m).filter(|&(_, &z)| z >= from_m);
    let places = upper.map(|((x, y), _)| x * direction[0] + y * direction[1]);
    let ends =
        places.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], t| [low.min(t), high.max(t)]);
    f64::from(ends[1] - ends[0])
}

/// Position of the sensor along an axis of the rectangle, m.
fn sensor_along(r: &Rectangle, origin_m: [f64; 2], axis: usize) -> f64 {
    let (sin, cos) = r.yaw_rad.sin_cos();
    let [x, y] = origin_m;
    [-(x * cos + y * sin), -(y * cos - x * sin)][axis]
}

/// Moves the edge that is farther from the sensor until the extent is reached: a vehicle straight ahead shows one face only,
/// and its tight box has nearly no length.
fn grow_away(r: &mut Rectangle, axis: usize, extent_m: f64, origin_m: [f64; 2]) {
    let sensor_m = sensor_along(r, origin_m, axis);
    let [low, high] = &mut r.sides_m[axis];
    let is_beyond = sensor_m <= (*low + *high) / 2.0;
    if *high - *low < extent_m && is_beyond {
        *high = *low + extent_m;
    } else if *high - *low < extent_m {
        *low = *high - extent_m;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_geometry::ground::GROUND_NODES;

    const EXTEND: Extend = Extend { to_ground: true, completes: true, top_rad: None };

    /// The box around points at these places, m, `x_m` away from the sensor and on ground 1.7 m below it.
    fn box_around(extend: &Extend, x_m: f64, places: impl Iterator<Item = [f32; 3]>) -> Box3 {
        let mut points = ClusterPoints::default();
        places.for_each(|[x, y, z]| points.push(x, y, z));
        points.origin_m = [x_m, 0.0];
        let ground_m = [-1.7; GROUND_NODES];
        extend.box_around(&points, &points.rectangle(0.0), &ground_m).expect("there are points")
    }

    /// A face across the line of sight, of this width and height, from 0.3 m above the ground on.
    fn face(width_m: f32, top_m: f32) -> impl Iterator<Item = [f32; 3]> {
        let at = move |i: usize, k: usize| {
            let y = width_m * (i as f32 / 20.0 - 0.5);
            [0.0, y, 0.3 + (top_m - 0.3) * k as f32 / 20.0 - 1.7]
        };
        (0..21 * 21).map(move |i| at(i / 21, i % 21))
    }

    #[test]
    fn one_face_grows_away_from_the_sensor() {
        // Wider than a car's end and lower than a truck's.
        for side in [1.0, -1.0] {
            let found = box_around(&EXTEND, side * 10.0, face(2.5, 1.5));
            assert!((found.size_m[0] - 2.5).abs() < 1e-5 && (found.size_m[1] - 1.0).abs() < 1e-5);
            let near_edge_m = found.center_m[0] - side * 0.5;
            assert!((near_edge_m - side * 10.0).abs() < 1e-5, "{found:?}");
            assert!((found.size_m[2] - 1.5).abs() < 1e-5, "down to the ground");
            assert!((found.yaw_rad.abs() - FRAC_PI_2).abs() < 1e-9);
        }
    }

    #[test]
    fn the_end_of_a_vehicle_gets_a_length_and_a_cyclists_side_does_not() {
        let car = box_around(&EXTEND, 10.0, face(1.7, 1.5));
        assert!((car.size_m[0] - 2.2 * 1.7).abs() < 1e-5, "{car:?}");
        assert!(car.yaw_rad.abs() < 1e-9 && (car.center_m[0] - 11.87).abs() < 1e-5);
        // Wheels below, one rider in the middle above.
        let cyclist = face(1.7, 1.5).filter(|[_, y, z]| *z < -0.8 || y.abs() < 0.3);
        let side = box_around(&EXTEND, 10.0, cyclist);
        assert!(side.size_m[1] < 0.9, "{side:?}");
    }

    #[test]
    fn a_truck_seen_up_to_the_topmost_beam_goes_on_above_it() {
        let extend = Extend { top_rad: Some(0.03), ..EXTEND };
        // 2.4 m at a distance of 20 m is above the last beam; lower ends and things too short for a truck are seen whole.
        for (length_m, top_m, expected_m) in [(8.0, 2.4, 3.2), (8.0, 2.0, 2.0), (1.0, 2.4, 2.4)] {
            let found = box_around(&extend, 20.0, face(length_m, top_m));
            assert!((found.size_m[2] - expected_m).abs() < 1e-5, "{found:?}");
        }
    }
}
