//! Oriented rectangles on the ground: what stands where, and whether two things would stand in each other.

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
    /// Of a thing with these lowest and highest corners, whose origin stands at `at`.
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

    fn axes(&self) -> [[f32; 2]; 2] {
        let (sin, cos) = self.yaw.sin_cos();
        [[cos, sin], [-sin, cos]]
    }

    /// Whether two rectangles come closer than `margin_m` to overlapping (separating axes).
    pub(crate) fn overlaps(&self, other: &Footprint, margin_m: f32) -> bool {
        let d = [other.x - self.x, other.y - self.y];
        let reach =
            self.half[0].hypot(self.half[1]) + other.half[0].hypot(other.half[1]) + margin_m;
        if d[0].hypot(d[1]) > reach {
            return false;
        }
        let (a, b) = (self.axes(), other.axes());
        let radius = |axes: &[[f32; 2]; 2], half: [f32; 2], n: [f32; 2]| {
            (0..2)
                .map(|i| half[i] * (axes[i][0] * n[0] + axes[i][1] * n[1]).abs())
                .sum::<f32>()
        };
        a.iter().chain(&b).all(|n| {
            (d[0] * n[0] + d[1] * n[1]).abs()
                < radius(&a, self.half, *n) + radius(&b, other.half, *n) + margin_m
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn separated_touching_and_crossing_rectangles() {
        let at = |x: f32, y: f32, yaw: f32| Footprint {
            x,
            y,
            yaw,
            half: [2.0, 1.0],
        };
        let a = at(0.0, 0.0, 0.0);
        assert!(a.overlaps(&at(3.9, 0.0, 0.0), 0.0));
        assert!(!a.overlaps(&at(4.1, 0.0, 0.0), 0.0));
        assert!(a.overlaps(&at(4.1, 0.0, 0.0), 0.2));
        // Turned by 90 degrees it is only one metre deep along x.
        assert!(!a.overlaps(&at(3.1, 0.0, std::f32::consts::FRAC_PI_2), 0.0));
        assert!(a.overlaps(&at(0.0, 0.0, 0.7), 0.0));
    }
}
