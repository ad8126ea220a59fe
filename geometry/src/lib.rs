//! Boxes, rotated overlap, non-maximum suppression, frames of reference.
//!
//! Sensor frame: x forward, y left, z up, metres. Angles in rad, yaw about +z, 0 along +x.

mod boxes;

pub use boxes::{Box3, limit_period};
