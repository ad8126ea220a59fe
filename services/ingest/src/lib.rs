//! Bytes of a scan to points: the first stage, as plain functions.
//!
//! [`decode_bin`] reads KITTI's `.bin` layout straight into the caller's memory and counts what it leaves out;
//! [`Sanity`] tells whether a scan looks like what the model was trained for. Nothing here opens a file or reads a clock.

mod decode;
mod packed;
mod sanity;

pub use decode::{DecodeReport, POINT_BYTES, bin_points, decode_bin, inspect_bin};
pub use packed::{PackedError, pack, unpack};
pub use sanity::{Finding, Sanity};
