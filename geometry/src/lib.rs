//! Boxes, rotated overlap, non-maximum suppression, coordinate frames, the ground; the workspace's only random generator, hash, quantile, bootstrap.
//!
//! Sensor frame: x forward, y left, z up, metres. Angles in rad, yaw about +z, 0 along +x.
//! Camera frame (KITTI "rect"): x right, y down, z forward, metres; [`Calibration`] converts between the two.

mod boxes;
mod calibration;
pub mod ground;
mod image;
mod overlap;
mod polygon;
mod random;
mod statistics;

pub use boxes::{Box3, Inside, limit_period};
pub use calibration::{Calibration, CalibrationError, CameraBox};
pub use image::{ImageSize, iou_2d, overlap_of_first_2d, pixel_bounds};
pub use overlap::{intersection_bev_m2, intersection_over_min_area, iou_3d, iou_bev, nms_into};
pub use polygon::Polygon;
pub use random::{FNV_OFFSET, Random, fnv1a, mix};
pub use statistics::{mean_and_spread, quantile, quantile_of, resample};
