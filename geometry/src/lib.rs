//! Boxes, rotated overlap, non-maximum suppression, frames of reference, the ground; the one random generator, quantile and bootstrap.
//!
//! Sensor frame: x forward, y left, z up, metres. Angles in rad, yaw about +z, 0 along +x.
//! Camera frame (KITTI "rect"): x right, y down, z forward, metres; [`Calibration`] goes between the two.

mod bootstrap;
mod boxes;
mod calibration;
pub mod ground;
mod image;
mod linear;
mod nms;
mod overlap;
mod polygon;
mod quantile;
mod random;

pub use bootstrap::{mean_and_spread, resample};
pub use boxes::{Box3, limit_period};
pub use calibration::{Calibration, CalibrationError, CameraBox};
pub use image::{ImageSize, iou_2d, overlap_of_first_2d, pixel_bounds};
pub use nms::nms_into;
pub use overlap::{intersection_bev_m2, intersection_over_min_area, iou_3d, iou_bev};
pub use polygon::Polygon;
pub use quantile::{quantile, quantile_of};
pub use random::{Random, mix};
