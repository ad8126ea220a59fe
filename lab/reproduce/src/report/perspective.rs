//! From the sensor frame to a picture: from above, or as an eye sees it.

/// Nearer than this a thing is behind the eye, m.
const NEAR_M: f64 = 0.5;

/// How places become pixels.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Projection {
    /// Forward (+x) is up, left (+y) is left.
    Above {
        /// x and y in the middle of the picture, m.
        center_m: [f64; 2],
        /// Pixels a metre.
        px_per_m: f64,
        /// Width and height, px.
        size_px: [usize; 2],
    },
    /// A pinhole.
    Eye {
        /// Where it is, m.
        eye_m: [f64; 3],
        /// To the right, down, forward: unit vectors.
        axes: [[f64; 3]; 3],
        /// Focal length, px.
        focal_px: f64,
        /// Width and height, px.
        size_px: [usize; 2],
    },
}

impl Projection {
    pub(super) fn above(center_m: [f64; 2], px_per_m: f64, size_px: [usize; 2]) -> Projection {
        Projection::Above {
            center_m,
            px_per_m,
            size_px,
        }
    }

    /// An eye on the sensor's side of a place, 15 m before it and 7 m above the sensor's feet, that looks at it.
    pub(super) fn towards(target_m: [f64; 2], size_px: [usize; 2]) -> Projection {
        let [x, y] = target_m;
        let range = x.hypot(y).max(1e-6);
        let (ux, uy) = (x / range, y / range);
        let eye_m = [x - 15.0 * ux, y - 15.0 * uy, 5.0];
        let down = (eye_m[2] + 1.2) / 15.0f64.hypot(eye_m[2] + 1.2);
        let flat = (1.0 - down * down).sqrt();
        Projection::Eye {
            eye_m,
            axes: [
                [uy, -ux, 0.0],
                [-down * ux, -down * uy, -flat],
                [flat * ux, flat * uy, -down],
            ],
            focal_px: 0.85 * size_px[0] as f64,
            size_px,
        }
    }

    /// Width and height, px.
    pub(super) fn size_px(&self) -> [usize; 2] {
        match self {
            Projection::Above { size_px, .. } | Projection::Eye { size_px, .. } => *size_px,
        }
    }

    /// Place in the picture and depth (from above: how far below the sensor, so that high things come last), m. `None` behind the
    /// eye, far outside the picture, and for what is not finite.
    pub(super) fn project(&self, place_m: [f64; 3]) -> Option<([f32; 2], f32)> {
        let [x, y, z] = place_m;
        let (at, depth) = match self {
            Projection::Above {
                center_m,
                px_per_m,
                size_px,
            } => {
                let right = (center_m[1] - y) * px_per_m + size_px[0] as f64 / 2.0;
                let down = (center_m[0] - x) * px_per_m + size_px[1] as f64 / 2.0;
                ([right, down], -z)
            }
            Projection::Eye {
                eye_m,
                axes,
                focal_px,
                size_px,
            } => {
                let d = [x - eye_m[0], y - eye_m[1], z - eye_m[2]];
                let along = |axis: &[f64; 3]| axis[0] * d[0] + axis[1] * d[1] + axis[2] * d[2];
                let depth = along(&axes[2]);
                if depth < NEAR_M {
                    return None;
                }
                let at =
                    [0, 1].map(|i| focal_px * along(&axes[i]) / depth + size_px[i] as f64 / 2.0);
                (at, depth)
            }
        };
        let inside = at.iter().all(|v| v.is_finite() && v.abs() < 1e4);
        inside.then(|| (at.map(|v| v as f32), depth as f32))
    }

    /// Whether points at this depth are drawn larger.
    pub(super) fn is_near(&self, depth: f32) -> bool {
        match self {
            Projection::Above { .. } => false,
            Projection::Eye { .. } => depth < 24.0,
        }
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
