//! From the sensor frame to a picture: from above, or as an eye sees it.

/// Nearer than this a thing is behind the eye, m.
const NEAR_M: f64 = 0.5;

/// How places become pixels.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Projection {
    /// Where the eye is, or, from above, what is in the middle of the picture, m.
    origin_m: [f64; 3],
    /// To the right, down, forward: unit vectors.
    axes: [[f64; 3]; 3],
    /// Focal length, px; from above pixels a metre.
    scale: f64,
    /// A pinhole; else all lines of sight are parallel.
    is_pinhole: bool,
    pub(super) size_px: [usize; 2],
}

impl Projection {
    /// From above: forward (+x) is up, left (+y) is left.
    pub(super) fn above([x, y]: [f64; 2], px_per_m: f64, size_px: [usize; 2]) -> Projection {
        Projection {
            origin_m: [x, y, 0.0],
            axes: [[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]],
            scale: px_per_m,
            is_pinhole: false,
            size_px,
        }
    }

    /// An eye on the sensor's side of a place, 15 m before it and 7 m above the sensor's feet, that looks at it.
    pub(super) fn towards([x, y]: [f64; 2], size_px: [usize; 2]) -> Projection {
        let range = x.hypot(y).max(1e-6);
        let (ux, uy) = (x / range, y / range);
        let origin_m = [x - 15.0 * ux, y - 15.0 * uy, 5.0];
        let down = (origin_m[2] + 1.2) / 15.0f64.hypot(origin_m[2] + 1.2);
        let flat = (1.0 - down * down).sqrt();
        Projection {
            origin_m,
            axes: [
                [uy, -ux, 0.0],
                [-down * ux, -down * uy, -flat],
                [flat * ux, flat * uy, -down],
            ],
            scale: 0.85 * size_px[0] as f64,
            is_pinhole: true,
            size_px,
        }
    }

    /// Place in the picture and depth (from above: how far below the sensor, so that high things come last), m. `None` behind the
    /// eye, far outside the picture, and for what is not finite.
    pub(super) fn project(&self, place_m: [f64; 3]) -> Option<([f32; 2], f32)> {
        let d = [0, 1, 2].map(|i| place_m[i] - self.origin_m[i]);
        let [right, down, depth] = self.axes.map(|a| a[0] * d[0] + a[1] * d[1] + a[2] * d[2]);
        if self.is_pinhole && depth < NEAR_M {
            return None;
        }
        let away = if self.is_pinhole { depth } else { 1.0 };
        let [right, down] = [right, down].map(|v| self.scale * v / away);
        let at = [
            right + self.size_px[0] as f64 / 2.0,
            down + self.size_px[1] as f64 / 2.0,
        ];
        let inside = at.iter().all(|v| v.is_finite() && v.abs() < 1e4);
        inside.then(|| (at.map(|v| v as f32), depth as f32))
    }

    /// Whether points at this depth are drawn larger.
    pub(super) fn is_near(&self, depth: f32) -> bool {
        self.is_pinhole && depth < 24.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_target_is_in_the_middle_and_left_is_left() {
        for target in [[20.0, 0.0], [-8.0, 15.0], [0.0, -30.0]] {
            let eye = Projection::towards(target, [300, 200]);
            let (at, _) = eye.project([target[0], target[1], -1.2]).expect("seen");
            assert!(
                (at[0] - 150.0).abs() < 1e-3 && (at[1] - 100.0).abs() < 1e-3,
                "{at:?}"
            );
            let (higher, _) = eye.project([target[0], target[1], 0.5]).expect("seen");
            assert!(higher[1] < at[1]);
        }
        let eye = Projection::towards([20.0, 0.0], [300, 200]);
        let (left, _) = eye.project([20.0, 3.0, -1.0]).expect("seen");
        assert!(left[0] < 150.0);
        assert!(eye.project([-30.0, 0.0, 0.0]).is_none());
        let above = Projection::above([20.0, 0.0], 10.0, [300, 200]);
        let (at, _) = above.project([25.0, 3.0, 0.0]).expect("seen");
        assert_eq!(at, [120.0, 50.0]);
    }
}
