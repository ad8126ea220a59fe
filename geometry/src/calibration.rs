//! Transforms between the sensor frame and KITTI's camera frame: `x_rect = R0_rect * Tr_velo_to_cam * x_sensor`,
//! `pixel = P2 * x_rect`. A label's location is the centre of the bottom face and its heading turns about the
//! camera's y axis, which points down: `yaw = -(rotation_y + pi / 2)`.

use crate::boxes::{Box3, limit_period};
use crate::image::{ImageSize, pixel_bounds};
use nalgebra::{Matrix3, Vector3};
use std::f64::consts::{FRAC_PI_2, PI};

/// The map from sensor to camera cannot be inverted, or contains a value that is not finite.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "calibration: R0_rect * Tr_velo_to_cam must be an invertible map of finite numbers, found one that is not"
)]
pub struct CalibrationError;

/// A box as KITTI's labels give it, in the camera frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CameraBox {
    /// Centre of the bottom face: x right, y down, z forward, m.
    pub location_m: [f64; 3],
    /// Height, width, length, m.
    pub size_hwl_m: [f64; 3],
    /// Heading about the camera's y axis, rad; 0 along the camera's +x.
    pub rotation_y_rad: f64,
}

impl CameraBox {
    /// The box relative to the camera's origin but along the sensor's axes: x forward, y left, z up.
    ///
    /// Two such boxes overlap exactly as they do in the camera frame, so labels and detections can be compared without a calibration.
    pub fn upright(&self) -> Box3 {
        let [x, y, z] = self.location_m;
        let [h, w, l] = self.size_hwl_m;
        let yaw_rad = -(self.rotation_y_rad + FRAC_PI_2);
        Box3::new([z, -x, -y + h / 2.0, l, w, h, yaw_rad])
    }

    /// The eight corners in the camera frame, m: four of the bottom face in order, then the four above them.
    pub fn corners_m(&self) -> [[f64; 3]; 8] {
        let [h, w, l] = self.size_hwl_m;
        let (sin, cos) = self.rotation_y_rad.sin_cos();
        let foot = [[0.5, 0.5], [0.5, -0.5], [-0.5, -0.5], [-0.5, 0.5]];
        std::array::from_fn(|i| {
            let ([u, v], [x, y, z]) = (foot[i % 4], self.location_m);
            let (u, v) = (u * l, v * w);
            let rise = if i < 4 { 0.0 } else { h };
            [x + u * cos + v * sin, y - rise, z - u * sin + v * cos]
        })
    }
}

/// Calibration of one frame: camera matrix and the map from sensor to camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    p2: [[f64; 4]; 3],
    r0_rect: [[f64; 3]; 3],
    velo_to_cam: [[f64; 4]; 3],
    rect_from_sensor: Affine,
    sensor_from_rect: Affine,
}

/// Smallest depth that is projected, m: the parts of a box nearer than this are cut off.
const DEPTH_MIN_M: f64 = 0.1;

impl Calibration {
    /// From KITTI's matrices, row by row. A `p2` of zeros means that there is no camera.
    pub fn new(
        p2: [[f64; 4]; 3],
        r0_rect: [[f64; 3]; 3],
        velo_to_cam: [[f64; 4]; 3],
    ) -> Result<Calibration, CalibrationError> {
        let rows = |m: [[f64; 3]; 3]| Matrix3::from(m).transpose();
        let turn = rows(velo_to_cam.map(|row| [row[0], row[1], row[2]]));
        let shift = Vector3::from(velo_to_cam.map(|row| row[3]));
        let rect_from_sensor =
            Affine { linear: rows(r0_rect) * turn, offset: rows(r0_rect) * shift };
        let sensor_from_rect = rect_from_sensor.inverse().ok_or(CalibrationError)?;
        let mut numbers = rect_from_sensor.offset.iter().chain(p2.as_flattened());
        if !numbers.all(|v| v.is_finite()) {
            return Err(CalibrationError);
        }
        Ok(Calibration { p2, r0_rect, velo_to_cam, rect_from_sensor, sensor_from_rect })
    }

    /// For a sensor without a camera: axes swapped, no shift, P2 all 0. The simulator's full-circle frames use it.
    pub fn without_camera() -> Calibration {
        let identity = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let axes = [[0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [1.0, 0.0, 0.0, 0.0]];
        Calibration::new([[0.0; 4]; 3], identity, axes).expect("an invertible map")
    }

    /// KITTI's matrices with their names, row by row: the left colour camera's projection, px; the rectifying rotation; camera 0 from sensor, m.
    pub fn matrices(&self) -> [(&'static str, &[f64]); 3] {
        [
            ("P2", self.p2.as_flattened()),
            ("R0_rect", self.r0_rect.as_flattened()),
            ("Tr_velo_to_cam", self.velo_to_cam.as_flattened()),
        ]
    }

    /// Whether there is a camera: false if P2 is all 0.
    pub fn has_camera(&self) -> bool {
        self.p2.iter().flatten().any(|&v| v != 0.0)
    }

    /// Converts a point from the sensor frame to the camera frame, m.
    pub fn rect_from_sensor(&self, point_in_sensor_m: [f64; 3]) -> [f64; 3] {
        self.rect_from_sensor.apply(point_in_sensor_m)
    }

    /// Direction of the camera's optical axis, rad about z from the sensor's x; 0 below 5 degrees, where KITTI's labels keep headings unchanged.
    fn turn_rad(&self) -> f64 {
        let [origin, ahead] = [[0.0; 3], [0.0, 0.0, 1.0]].map(|p| self.sensor_from_rect.apply(p));
        let turn_rad = (ahead[1] - origin[1]).atan2(ahead[0] - origin[0]);
        if turn_rad.abs() < 5f64.to_radians() {
            return 0.0;
        }
        turn_rad
    }

    /// A label's box in the sensor frame. The box stays upright: the small tilt between the frames changes its centre and not its axes.
    pub fn box_in_sensor_from_label(&self, label: &CameraBox) -> Box3 {
        let [h, w, l] = label.size_hwl_m;
        let [x, y, z_bottom] = self.sensor_from_rect.apply(label.location_m);
        let yaw_rad = self.turn_rad() - (label.rotation_y_rad + FRAC_PI_2);
        let yaw_rad = limit_period(yaw_rad, 0.5, 2.0 * PI);
        Box3::new([x, y, z_bottom + h / 2.0, l, w, h, yaw_rad])
    }

    /// The inverse of [`Self::box_in_sensor_from_label`].
    pub fn label_from_box_in_sensor(&self, box_in_sensor: &Box3) -> CameraBox {
        let [l, w, h] = box_in_sensor.size_m;
        let [x, y, z] = box_in_sensor.center_m;
        let rotation_y_rad = self.turn_rad() - box_in_sensor.yaw_rad - FRAC_PI_2;
        let rotation_y_rad = limit_period(rotation_y_rad, 0.5, 2.0 * PI);
        CameraBox {
            location_m: self.rect_from_sensor([x, y, z - h / 2.0]),
            size_hwl_m: [h, w, l],
            rotation_y_rad,
        }
    }

    /// Projects a point of the sensor frame into the image, px; `None` without a camera or for a point behind it.
    pub fn project_point_to_image(&self, point_in_sensor_m: [f64; 3]) -> Option<[f64; 2]> {
        let [u, v, depth] = self.homogeneous(self.rect_from_sensor(point_in_sensor_m));
        (depth >= DEPTH_MIN_M).then(|| [u / depth, v / depth])
    }

    /// A label's box in the image: left, top, right, bottom, px, around its projected corners, clipped to the image
    /// (0 to width - 1, 0 to height - 1). `None` when nothing of it is seen, or without a camera.
    pub fn project_label_to_image(&self, label: &CameraBox, image: ImageSize) -> Option<[f64; 4]> {
        let corners = label.corners_m().map(|corner| self.homogeneous(corner));
        let around = (0..4).map(|i| (i, (i + 1) % 4));
        let edges = around.flat_map(|(i, next)| [(i, next), (i + 4, next + 4), (i, i + 4)]);
        // Both ends of the edge's part in front of the camera; a corner behind it would project mirrored.
        let ends = edges.flat_map(|(a, b)| [(corners[a], corners[b]), (corners[b], corners[a])]);
        image.clip(pixel_bounds(ends.filter_map(|(a, b)| visible_end_px(a, b))))
    }

    fn homogeneous(&self, p: [f64; 3]) -> [f64; 3] {
        self.p2.map(|row| row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + row[3])
    }
}

/// The visible end of an edge on the side of `a`, px: `a` itself, or the intersection with the smallest depth.
fn visible_end_px(a: [f64; 3], b: [f64; 3]) -> Option<[f64; 2]> {
    if a[2] >= DEPTH_MIN_M {
        return Some([a[0] / a[2], a[1] / a[2]]);
    }
    if b[2] < DEPTH_MIN_M || b[2].is_nan() {
        return None;
    }
    let t = (DEPTH_MIN_M - a[2]) / (b[2] - a[2]);
    Some([0, 1].map(|i| (a[i] + t * (b[i] - a[i])) / DEPTH_MIN_M))
}

/// A rotation (or any 3 x 3 map) and a translation: `target = linear * source + offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Affine {
    linear: Matrix3<f64>,
    offset: Vector3<f64>,
}

impl Affine {
    fn apply(&self, point: [f64; 3]) -> [f64; 3] {
        (self.linear * Vector3::from(point) + self.offset).into()
    }

    /// The inverse map, or `None` when the determinant is not a finite number away from 0.
    fn inverse(&self) -> Option<Affine> {
        let determinant = self.linear.determinant();
        let is_regular = determinant.is_finite() && determinant.abs() >= 1e-9;
        let linear = self.linear.try_inverse().filter(|_| is_regular)?;
        let offset = -(linear * self.offset);
        Some(Affine { linear, offset })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers like those in KITTI's files: a small tilt, a lever arm, a focal length of 721.5 px.
    fn kitti_like() -> Calibration {
        let (s, c) = 0.01f64.sin_cos();
        Calibration::new(
            [[721.5, 0.0, 609.6, 44.9], [0.0, 721.5, 172.9, 0.2], [0.0, 0.0, 1.0, 0.003]],
            [[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]],
            [[0.0, -1.0, 0.0, -0.004], [0.0, 0.0, -1.0, -0.076], [1.0, 0.0, 0.0, -0.272]],
        )
        .expect("valid")
    }

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-9
    }

    #[test]
    fn boxes_survive_the_round_trip() {
        let calibration = kitti_like();
        let b = Box3::new([12.0, -3.0, -0.8, 4.1, 1.7, 1.5, 0.4]);
        let back = calibration.box_in_sensor_from_label(&calibration.label_from_box_in_sensor(&b));
        for i in 0..3 {
            assert!(close(back.center_m[i], b.center_m[i]) && close(back.size_m[i], b.size_m[i]));
        }
        assert!(close(back.yaw_rad, b.yaw_rad));
    }

    #[test]
    fn a_sensor_whose_y_points_ahead_turns_headings_too() {
        let axes = [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0]];
        let like = kitti_like();
        let turned = Calibration::new(like.p2, like.r0_rect, axes).expect("valid");
        // Ahead of the camera, facing away.
        let label = CameraBox {
            location_m: [0.0, 0.0, 20.0],
            size_hwl_m: [1.5, 1.7, 4.1],
            rotation_y_rad: -FRAC_PI_2,
        };
        let found = turned.box_in_sensor_from_label(&label);
        assert!((found.yaw_rad - FRAC_PI_2).abs() < 0.02, "{found:?}");
        let back = turned.label_from_box_in_sensor(&found);
        assert!(close(back.rotation_y_rad, label.rotation_y_rad));
    }

    #[test]
    fn a_car_straight_ahead_faces_away_and_lies_in_the_middle() {
        let calibration = Calibration::without_camera();
        // Heading along +x of the sensor is -pi/2 about the camera's y axis.
        let label = CameraBox {
            location_m: [0.0, 1.7, 20.0],
            size_hwl_m: [1.5, 1.6, 4.0],
            rotation_y_rad: -FRAC_PI_2,
        };
        let b = calibration.box_in_sensor_from_label(&label);
        assert_eq!(b.size_m, [4.0, 1.6, 1.5]);
        let [x, y, z] = b.center_m;
        assert!(close(x, 20.0) && close(y, 0.0) && close(z, -0.95) && close(b.yaw_rad, 0.0));
        let seen = calibration.project_label_to_image(&label, ImageSize::KITTI);
        assert!(!calibration.has_camera() && seen.is_none());
        assert_eq!(label.upright().center_m, b.center_m);
    }

    #[test]
    fn projection_is_clipped_to_the_image() {
        let calibration = kitti_like();
        let project = |v| {
            let label = calibration.label_from_box_in_sensor(&Box3::new(v));
            calibration.project_label_to_image(&label, ImageSize::KITTI)
        };
        let ahead = project([20.0, 0.0, -0.9, 4.0, 1.6, 1.5, 0.0]).expect("seen");
        assert!(ahead[0] > 500.0 && ahead[2] < 720.0, "{ahead:?}");
        assert!(ahead[1] > 150.0 && ahead[3] < 260.0, "{ahead:?}");
        assert!(project([-20.0, 0.0, -0.9, 4.0, 1.6, 1.5, 0.0]).is_none());
        assert!(project([5.0, 40.0, -0.9, 4.0, 1.6, 1.5, 0.0]).is_none());
        // Half behind the camera: the box reaches the image's lower edge and is not mirrored.
        let beside = project([1.0, 2.5, -0.9, 6.0, 1.6, 1.5, 0.0]).expect("seen");
        assert_eq!((beside[0], beside[3]), (0.0, 374.0));
        assert!(beside[2] < 620.0, "{beside:?}");
    }

    #[test]
    fn the_corners_agree_with_the_upright_box() {
        let label = CameraBox {
            location_m: [3.0, 1.6, 15.0],
            size_hwl_m: [1.4, 1.6, 3.9],
            rotation_y_rad: 0.7,
        };
        let b = label.upright();
        for corner in label.corners_m() {
            let p = b.local_m([corner[2], -corner[0], -corner[1]]);
            for i in 0..3 {
                assert!(close(p[i].abs(), b.size_m[i] / 2.0), "{p:?}");
            }
        }
    }
}
