//! One LiDAR return.

use bytemuck::{Pod, Zeroable};
#[cfg(feature = "iceoryx2")]
use iceoryx2::prelude::ZeroCopySend;

use crate::{ContractError, FrameHeader, POINTS_MAX};

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
    /// Checks a points message: version and count. The numbers are not read here: a stage that meets one that is not
    /// finite leaves that point out.
    pub fn checked<'a>(
        header: &FrameHeader,
        points: &'a [Point],
    ) -> Result<&'a [Point], ContractError> {
        header.checked()?;
        if points.len() <= POINTS_MAX {
            Ok(points)
        } else {
            Err(ContractError::TooLong {
                what: "points",
                limit: POINTS_MAX,
                found: points.len(),
            })
        }
    }

    /// Whether all four numbers are finite.
    pub fn is_finite(&self) -> bool {
        self.x_m.is_finite()
            && self.y_m.is_finite()
            && self.z_m.is_finite()
            && self.intensity.is_finite()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scan_at_the_limit_passes_and_one_beyond_does_not() {
        let header = FrameHeader::new(0, "a");
        let points = vec![Point::default(); POINTS_MAX + 1];
        assert!(Point::checked(&header, &points[..POINTS_MAX]).is_ok());
        let error = Point::checked(&header, &points).unwrap_err();
        assert_eq!(
            error.to_string(),
            "points: 262145 exceeds the limit of 262144"
        );
    }

    #[test]
    fn another_wire_version_is_refused() {
        let mut header = FrameHeader::new(0, "a");
        header.wire_version = 7;
        let error = Point::checked(&header, &[]).unwrap_err();
        assert!(matches!(error, ContractError::WireVersion { found: 7, .. }));
    }
}
