//! Decodes the bytes of a scan to points: the first stage, as plain functions.
//!
//! [`decode_bin`] reads KITTI's `.bin` layout straight into the caller's memory and counts the points that it drops; [`estimate`] estimates the sensor;
//! [`Guard`] checks whether scans look like the input that the model takes. Nothing here opens a file or reads a clock.

mod decode;
pub mod estimate;
mod guard;

pub use decode::{DecodeReport, POINT_BYTES, bin_points, decode_bin, inspect_bin};
pub use guard::{Expected, Guard, Reason};
