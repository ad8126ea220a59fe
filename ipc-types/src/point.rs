//! One LiDAR return.

use bytemuck::{Pod, Zeroable};

/// Sensor frame: x forward, y left, z up. Finite, as ingest publishes it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
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
