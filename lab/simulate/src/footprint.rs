//! Oriented rectangles on the ground: the ground that things take, and whether two things overlap.

use super::mesh::V3;

/// A rectangle: middle, heading, half length, half width (m, rad).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Footprint {
    pub(crate) x: f32,
    pub(crate) y: f32,
    pub(crate) yaw: f32,
    pub(crate) half: [f32; 2],
}

impl Footprint {
    /// Footprint of a thing that is aligned with x, its middle at `x`.
    pub(crate) const fn ahead(x: f32, half: [f32; 2]) -> Footprint {
        let (y, yaw) = (0.0, 0.0);
        Footprint { x, y, yaw, half }
    }

    /// Footprint of a thing with these lowest and highest corners, with its origin at `at`.
    pub(crate) fn of(low: V3, high: V3, at: [f32; 2], yaw: f32) -> Footprint {
        let middle = (low + high) / 2.0;
        let (sin, cos) = yaw.sin_cos();
        Footprint {
            x: at[0] + middle.x * cos - middle.y * sin,
            y: at[1] + middle.x * sin + middle.y * cos,
            yaw,
            half: [(high.x - low.x) / 2.0, (high.y - low.y) / 2.0],
        }
    }

    /// Whether two rectangles overlap or are closer than `margin_m` (separating axes).
    pub(crate) fn overlaps(&self, other: &Footprint, margin_m: f32) -> bool {
        let d = [other.x - self.x, other.y - self.y];
        let [reach, other_reach] = [self, other].map(|f| f.half[0].hypot(f.half[1]));
        if d[0].hypot(d[1]) > reach + other_reach + margin_m {
            return false;
        }
        let axes = |f: &Footprint| {
            let (sin, cos) = f.yaw.sin_cos();
            [[cos, sin], [-sin, cos]]
        };
        let dot = |a: [f32; 2], b: [f32; 2]| a[0] * b[0] + a[1] * b[1];
        // Half extent of a rectangle along a direction.
        let radius = |f: &Footprint, n: [f32; 2]| {
            let [along, across] = axes(f);
            f.half[0] * dot(along, n).abs() + f.half[1] * dot(across, n).abs()
        };
        let mut directions = axes(self).into_iter().chain(axes(other));
        directions.all(|n| dot(d, n).abs() < radius(self, n) + radius(other, n) + margin_m)
    }
}
