//! The parts of a box that the sensor does not see: down to the ground, and away from the sensor.

use mluc_geometry::Box3;

use super::{ClusterPoints, Rectangle};
use crate::ground::GroundPlane;

/// Least extent of a side that is hardly seen, m and as a share of the other side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Side {
    /// m.
    pub least_m: f64,
    /// Of the other side's extent,
    pub share: f64,
    /// but no more than this, m: no road user is wider.
    pub most_m: f64,
}

/// A large thing that goes on above the sensor's topmost beam.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CutTop {
    /// Elevation of the topmost beams, rad: returns at least this high are the sensor's last.
    pub elevation_rad: f64,
    /// Only what is at least so long, m, and
    pub length_min_m: f64,
    /// at least so high as it is seen, m: a truck, not a car close by.
    pub seen_min_m: f64,
    /// Its height above the ground is at least this, m.
    pub height_m: f64,
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
    /// What is known of vehicles seen from the end: the first that fits counts.
    pub end_faces: [Option<EndFace>; 2],
    /// What is known of things that the sensor does not see the top of.
    pub cut_top: Option<CutTop>,
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
                side.least_m.max((side.share * v).min(side.most_m)),
                sensor_along(&r, origin_m, 0),
            );
            r.v_m = grow_away(
                r.v_m,
                side.least_m.max((side.share * u).min(side.most_m)),
                sensor_along(&r, origin_m, 1),
            );
        }
        let height_m = z_m[1] - ground.z_at_m(origin_m[0], origin_m[1]);
        let mut faces = self.end_faces.iter().flatten();
        faces.find(|face| {
            height_m >= face.height_min_m && face.lengthen(&mut r, points, z_m, origin_m)
        });
        let [x, y] = r.center_m();
        let (x, y) = (x + origin_m[0], y + origin_m[1]);
        let bottom = if self.to_ground {
            z_m[0].min(ground.z_at_m(x, y))
        } else {
            z_m[0]
        };
        let [u, v] = r.size_m();
        let top = match &self.cut_top {
            Some(cut) if cut.holds(u.max(v), height_m, points, origin_m) => {
                z_m[1].max(ground.z_at_m(x, y) + cut.height_m)
            }
            _ => z_m[1],
        };
        // The longer side is the length.
        let (l, w, yaw_rad) = if u >= v {
            (u, v, r.yaw_rad)
        } else {
            (v, u, r.yaw_rad + std::f64::consts::FRAC_PI_2)
        };
        let [least_l, least_w, least_h] = self.size_min_m;
        Some(Box3 {
            center_m: [x, y, (bottom + top) / 2.0],
            size_m: [l.max(least_l), w.max(least_w), (top - bottom).max(least_h)],
            yaw_rad: mluc_geometry::limit_period(yaw_rad, 0.5, std::f64::consts::PI),
        })
    }
}

impl CutTop {
    fn holds(
        &self,
        length_m: f64,
        seen_m: f64,
        points: &ClusterPoints,
        origin_m: [f64; 2],
    ) -> bool {
        if length_m < self.length_min_m || seen_m < self.seen_min_m {
            return false;
        }
        let (x, y) = (origin_m[0] as f32, origin_m[1] as f32);
        let tangent = self.elevation_rad.tan() as f32;
        let columns = points.x_m.iter().zip(&points.y_m).zip(&points.z_m);
        // Compared without a root; below the sensor nothing is at its top.
        columns.into_iter().any(|((px, py), &z)| {
            let flat = (px + x) * (px + x) + (py + y) * (py + y);
            z > 0.0 && z * z >= tangent * tangent * flat
        })
    }
}

impl EndFace {
    /// Grows the side that lies along the line of sight; whether this is such a face.
    fn lengthen(
        &self,
        r: &mut Rectangle,
        points: &ClusterPoints,
        z_m: [f64; 2],
        origin_m: [f64; 2],
    ) -> bool {
        let (u, v) = (sensor_along(r, origin_m, 0), sensor_along(r, origin_m, 1));
        let along_u = u.abs() > v.abs();
        let (ahead, aside) = (u.abs().max(v.abs()), u.abs().min(v.abs()));
        if aside > ahead * self.aside_max_rad.tan() {
            return false;
        }
        let width = r.size_m()[usize::from(along_u)];
        let fits = (self.width_m[0]..=self.width_m[1]).contains(&width);
        if !fits || self.top_width_m(r, points, z_m, along_u) < self.top_share_min * width {
            return false;
        }
        if along_u {
            r.u_m = grow_away(r.u_m, self.share * width, u);
        } else {
            r.v_m = grow_away(r.v_m, self.share * width, v);
        }
        true
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
    if sensor_m <= (low + high) / 2.0 {
        [low, low + extent_m]
    } else {
        [high - extent_m, high]
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
            most_m: 2.5,
        }),
        end_faces: [None; 2],
        cut_top: None,
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
            end_faces: [Some(face), None],
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

    #[test]
    fn a_truck_seen_up_to_the_topmost_beam_goes_on_above_it() {
        let cut = CutTop {
            elevation_rad: 0.03,
            length_min_m: 3.0,
            seen_min_m: 1.9,
            height_m: 3.2,
        };
        let extend = Extend {
            cut_top: Some(cut),
            ..EXTEND
        };
        // Its side, 20 m away: seen up to some height above ground 1.7 m below the sensor.
        let side = |length: f32, top_m: f32| {
            let mut points = ClusterPoints::default();
            for i in 0..=30 {
                for k in 0..=10 {
                    let z = 0.3 + (top_m - 0.3) * 0.1 * k as f32 - 1.7;
                    points.push(0.0, length * i as f32 / 30.0, z);
                }
            }
            let ground = GroundPlane::flat([20.0, 0.0], 1.7);
            let tight = points.rectangle(0.0);
            let found = extend.box_around(&points, &tight, [20.0, 0.0], &ground);
            found.map(|b| b.size_m[2]).expect("there are points")
        };
        assert!(
            (side(8.0, 2.4) - 3.2).abs() < 1e-5,
            "2.4 m is above the last beam"
        );
        assert!((side(8.0, 2.0) - 2.0).abs() < 1e-5, "its top is seen");
        assert!((side(2.0, 2.4) - 2.4).abs() < 1e-5, "too short for a truck");
    }
}
