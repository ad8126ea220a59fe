//! The parts of a box that the sensor does not see: down to the ground, and away from the sensor.

use mluc_geometry::Box3;

use super::{ClusterPoints, Rectangle};
use crate::ground::GroundPlane;

/// Least extent of a side that is hardly seen, m and as a share of the other side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Side {
    /// m.
    pub least_m: f64,
    /// Of the other side's extent.
    pub share: f64,
}

/// A face that looks like a vehicle's front or rear, seen from the end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EndFace {
    /// Narrowest and widest, m.
    pub width_m: [f64; 2],
    /// Least height of the box, m.
    pub height_min_m: f64,
    /// Largest angle between the line of sight and the vehicle's length, rad: further round, its side is seen too.
    pub aside_max_rad: f64,
    /// The vehicle is at least this share of its width long.
    pub share: f64,
    /// Its upper third is at least this share of the width wide: a cyclist seen from the side is narrow above.
    pub top_share_min: f64,
}

/// How a tight rectangle becomes a box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extend {
    /// Whether the bottom goes down to the ground.
    pub to_ground: bool,
    /// Sides shorter than this grow away from the sensor, the near edge stays: a vehicle straight ahead shows one face
    /// only, and its tight box is as thin as paper.
    pub away_from_sensor: Option<Side>,
    /// What is known of vehicles seen from the end.
    pub end_face: Option<EndFace>,
    /// Least l, w, h, m.
    pub size_min_m: [f64; 3],
}

impl Extend {
    /// The box around a cluster and its tight rectangle; the points have their origin at `origin_m`. `None` without
    /// points.
    pub fn box_around(
        &self,
        points: &ClusterPoints,
        tight: &Rectangle,
        origin_m: [f64; 2],
        ground: &GroundPlane,
    ) -> Option<Box3> {
        let z_m = points.z_range_m()?.map(f64::from);
        let mut r = *tight;
        if let Some(side) = self.away_from_sensor {
            let [u, v] = r.size_m();
            r.u_m = grow_away(
                r.u_m,
                side.least_m.max(side.share * v),
                sensor_along(&r, origin_m, 0),
            );
            r.v_m = grow_away(
                r.v_m,
                side.least_m.max(side.share * u),
                sensor_along(&r, origin_m, 1),
            );
        }
        let height_m = z_m[1] - ground.z_at_m(origin_m[0], origin_m[1]);
        if let Some(face) = self.end_face.filter(|face| height_m >= face.height_min_m) {
            face.lengthen(&mut r, points, z_m, origin_m);
        }
        let [x, y] = r.center_m();
        let (x, y) = (x + origin_m[0], y + origin_m[1]);
        let bottom = match self.to_ground {
            true => z_m[0].min(ground.z_at_m(x, y)),
            false => z_m[0],
        };
        let [u, v] = r.size_m();
        // The longer side is the length.
        let (l, w, yaw_rad) = match u >= v {
            true => (u, v, r.yaw_rad),
            false => (v, u, r.yaw_rad + std::f64::consts::FRAC_PI_2),
        };
        let [least_l, least_w, least_h] = self.size_min_m;
        Some(Box3 {
            center_m: [x, y, (bottom + z_m[1]) / 2.0],
            size_m: [
                l.max(least_l),
                w.max(least_w),
                (z_m[1] - bottom).max(least_h),
            ],
            yaw_rad: mluc_geometry::limit_period(yaw_rad, 0.5, std::f64::consts::PI),
        })
    }
}

impl EndFace {
    /// Grows the side that lies along the line of sight.
    fn lengthen(
        &self,
        r: &mut Rectangle,
        points: &ClusterPoints,
        z_m: [f64; 2],
        origin_m: [f64; 2],
    ) {
        let (u, v) = (sensor_along(r, origin_m, 0), sensor_along(r, origin_m, 1));
        let along_u = u.abs() > v.abs();
        let (ahead, aside) = (u.abs().max(v.abs()), u.abs().min(v.abs()));
        if aside > ahead * self.aside_max_rad.tan() {
            return;
        }
        let width = r.size_m()[usize::from(along_u)];
        let fits = (self.width_m[0]..=self.width_m[1]).contains(&width);
        if !fits || self.top_width_m(r, points, z_m, along_u) < self.top_share_min * width {
            return;
        }
        match along_u {
            true => r.u_m = grow_away(r.u_m, self.share * width, u),
            false => r.v_m = grow_away(r.v_m, self.share * width, v),
        }
    }

    /// Extent of the upper third of the points across the line of sight, m.
    fn top_width_m(
        &self,
        r: &Rectangle,
        points: &ClusterPoints,
        z_m: [f64; 2],
        along_u: bool,
    ) -> f64 {
        let (sin, cos) = (r.yaw_rad.sin() as f32, r.yaw_rad.cos() as f32);
        let across = if along_u { [-sin, cos] } else { [cos, sin] };
        let from_m = (z_m[1] - (z_m[1] - z_m[0]) / 3.0) as f32;
        let columns = points.x_m.iter().zip(&points.y_m).zip(&points.z_m);
        let ends = columns
            .filter(|&(_, &z)| z >= from_m)
            .map(|((x, y), _)| x * across[0] + y * across[1])
            .fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], t| {
                [low.min(t), high.max(t)]
            });
        f64::from(ends[1] - ends[0])
    }
}

/// Where the sensor lies along an axis of the rectangle, m.
fn sensor_along(r: &Rectangle, origin_m: [f64; 2], axis: usize) -> f64 {
    let (sin, cos) = r.yaw_rad.sin_cos();
    match axis {
        0 => -(origin_m[0] * cos + origin_m[1] * sin),
        _ => -(origin_m[1] * cos - origin_m[0] * sin),
    }
}

/// Moves the edge that is farther from the sensor until the extent is reached.
fn grow_away([low, high]: [f64; 2], extent_m: f64, sensor_m: f64) -> [f64; 2] {
    if high - low >= extent_m {
        return [low, high];
    }
    match sensor_m <= (low + high) / 2.0 {
        true => [low, low + extent_m],
        false => [high - extent_m, high],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EXTEND: Extend = Extend {
        to_ground: true,
        away_from_sensor: Some(Side {
            least_m: 0.8,
            share: 0.45,
        }),
        end_face: None,
        size_min_m: [0.1; 3],
    };

    /// The rear face of a car 10 m away, seen from behind: 1.7 m wide, from 0.3 to 1.5 m above the ground.
    fn rear_face(x_m: f32) -> (ClusterPoints, Rectangle) {
        let mut points = ClusterPoints::default();
        for i in 0..=17 {
            for k in 0..=12 {
                points.push(x_m, -0.85 + 0.1 * i as f32, -1.4 + 0.1 * k as f32);
            }
        }
        let rectangle = points.rectangle(0.0);
        (points, rectangle)
    }

    fn rear_box(extend: &Extend, x_m: f32, origin_x_m: f64) -> Box3 {
        let origin = [origin_x_m, 0.0];
        let (points, rectangle) = rear_face(x_m);
        let ground = GroundPlane::flat(origin, 1.7);
        let found = extend.box_around(&points, &rectangle, origin, &ground);
        found.expect("there are points")
    }

    #[test]
    fn one_face_grows_away_from_the_sensor() {
        let ahead = rear_box(&EXTEND, -2.0, 10.0);
        assert!((ahead.size_m[0] - 1.7).abs() < 1e-5 && (ahead.size_m[1] - 0.8).abs() < 1e-5);
        assert!(
            (ahead.center_m[0] - 8.4).abs() < 1e-5,
            "the near edge stays at 8 m: {ahead:?}"
        );
        assert!((ahead.size_m[2] - 1.5).abs() < 1e-5, "down to the ground");
        assert!((ahead.yaw_rad.abs() - std::f64::consts::FRAC_PI_2).abs() < 1e-9);
        let behind = rear_box(&EXTEND, 2.0, -10.0);
        assert!((behind.center_m[0] + 8.4).abs() < 1e-5, "{behind:?}");
    }

    #[test]
    fn the_end_of_a_vehicle_gets_a_length_and_a_cyclists_side_does_not() {
        let face = EndFace {
            width_m: [1.2, 2.6],
            height_min_m: 1.0,
            aside_max_rad: 0.5,
            share: 1.8,
            top_share_min: 0.6,
        };
        let extend = Extend {
            end_face: Some(face),
            ..EXTEND
        };
        let car = rear_box(&extend, -2.0, 10.0);
        assert!((car.size_m[0] - 1.8 * 1.7).abs() < 1e-5, "{car:?}");
        assert!(car.yaw_rad.abs() < 1e-9 && (car.center_m[0] - 9.53).abs() < 1e-5);
        // Wheels below, one rider in the middle above.
        let (points, rectangle) = rear_face(-2.0);
        let mut cyclist = ClusterPoints::default();
        for i in 0..points.len() {
            if points.z_m[i] < -0.8 || points.y_m[i].abs() < 0.3 {
                cyclist.push(points.x_m[i], points.y_m[i], points.z_m[i]);
            }
        }
        let ground = GroundPlane::flat([10.0, 0.0], 1.7);
        let side = extend.box_around(&cyclist, &rectangle, [10.0, 0.0], &ground);
        assert!(side.is_some_and(|b| b.size_m[1] < 0.9), "{side:?}");
    }
}
