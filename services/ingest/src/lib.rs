//! Bytes of a scan to points: the first stage, as plain functions.
//!
//! [`decode_bin`] reads KITTI's `.bin` layout straight into the caller's memory and counts what it leaves out; [`estimate`] says what the sensor is;
//! [`Guard`] tells whether scans look like what the model takes. Nothing here opens a file or reads a clock.

mod decode;
pub mod estimate;
mod guard;

pub use decode::{DecodeReport, POINT_BYTES, bin_points, decode_bin, inspect_bin};
pub use guard::{Expected, Guard, Reason};
