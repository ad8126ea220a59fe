//! The parts of a box that the sensor does not see: down to the ground, and away from the sensor.

use mluc_geometry::Box3;

use super::Rectangle;
use crate::ground::GroundPlane;

/// Least extent of a side that is hardly seen, m and as a share of the other side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Side {
    /// m.
    pub least_m: f64,
    /// Of the other side's extent.
    pub share: f64,
}

/// How a tight rectangle becomes a box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extend {
    /// Whether the bottom goes down to the ground.
    pub to_ground: bool,
    /// Sides shorter than this grow away from the sensor, the near edge stays: a vehicle straight ahead shows one face
    /// only, and its tight box is as thin as paper.
    pub away_from_sensor: Option<Side>,
    /// Least l, w, h, m.
    pub size_min_m: [f64; 3],
}

impl Extend {
    /// The box around a rectangle whose points have their origin at `origin_m` and lie between two heights, m.
    pub fn box_around(
        &self,
        tight: &Rectangle,
        z_m: [f64; 2],
        origin_m: [f64; 2],
        ground: &GroundPlane,
    ) -> Box3 {
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
        Box3 {
            center_m: [x, y, (bottom + z_m[1]) / 2.0],
            size_m: [
                l.max(least_l),
                w.max(least_w),
                (z_m[1] - bottom).max(least_h),
            ],
            yaw_rad: mluc_geometry::limit_period(yaw_rad, 0.5, std::f64::consts::PI),
        }
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
        size_min_m: [0.1; 3],
    };

    /// The rear face of a car 10 m ahead, seen from behind.
    fn rear_face() -> Rectangle {
        Rectangle {
            yaw_rad: 0.0,
            u_m: [-2.0, -1.95],
            v_m: [-0.85, 0.85],
        }
    }

    #[test]
    fn one_face_grows_away_from_the_sensor() {
        let ground = GroundPlane::flat([10.0, 0.0], 1.7);
        let b = EXTEND.box_around(&rear_face(), [-1.4, -0.2], [10.0, 0.0], &ground);
        assert!((b.size_m[0] - 1.7).abs() < 1e-9 && (b.size_m[1] - 0.8).abs() < 1e-9);
        assert!(
            (b.center_m[0] - 8.4).abs() < 1e-9,
            "the near edge stays at 8 m: {b:?}"
        );
        assert!((b.size_m[2] - 1.5).abs() < 1e-9, "down to the ground");
        let behind = EXTEND.box_around(
            &Rectangle {
                u_m: [1.95, 2.0],
                ..rear_face()
            },
            [-1.4, -0.2],
            [-10.0, 0.0],
            &ground,
        );
        assert!((behind.center_m[0] + 8.4).abs() < 1e-9, "{behind:?}");
    }

    #[test]
    fn the_heading_follows_the_longer_side() {
        let ground = GroundPlane::flat([10.0, 0.0], 1.7);
        let b = EXTEND.box_around(&rear_face(), [-1.4, -0.2], [10.0, 0.0], &ground);
        assert!((b.yaw_rad.abs() - std::f64::consts::FRAC_PI_2).abs() < 1e-9);
    }
}
