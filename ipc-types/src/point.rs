//! One LiDAR return.

use crate::{FrameHeader, POINTS_MAX, error::Result, error::check_length};
use bytemuck::{Pod, Zeroable};
#[cfg(feature = "iceoryx2")]
use iceoryx2::prelude::ZeroCopySend;

/// Sensor frame: x forward, y left, z up. Finite, as ingest publishes it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[cfg_attr(feature = "iceoryx2", derive(ZeroCopySend), type_name("mluc.Point"))]
#[repr(C)]
pub struct Point {
    /// m.
    pub x_m: f32,
    /// m.
    pub y_m: f32,
    /// m.
    pub z_m: f32,
    /// 0 to 1.
    pub intensity: f32,
}

const _: () = assert!(size_of::<Point>() == 16);

impl Point {
    /// Checks a points message: version and count. It does not read the numbers: a stage leaves out a point that is not finite.
    pub fn checked<'a>(header: &FrameHeader, points: &'a [Point]) -> Result<&'a [Point]> {
        header.checked()?;
        check_length("points", points.len(), POINTS_MAX)?;
        Ok(points)
    }

    /// Whether all four numbers are finite.
    pub fn is_finite(&self) -> bool {
        [self.x_m, self.y_m, self.z_m, self.intensity].iter().all(|number| number.is_finite())
    }
}
