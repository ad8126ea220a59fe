//! The plane that the lowest points of most tiles lie on.

use nalgebra::{Matrix3, Vector3};
use std::ops::Range;

/// Step between the slopes that are tried.
const SLOPE_STEP: f32 = 0.05;
/// Maximum number of heights that are tried per slope.
const HEIGHTS_MAX: usize = 128;
/// Minimum number of tiles on a plane.
const TILES_MIN: u32 = 12;

/// z = `z_m` + slope . (x, y).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GroundPlane {
    /// Height at the sensor, m.
    pub z_m: f64,
    /// dz/dx and dz/dy.
    pub slope: [f64; 2],
}

impl GroundPlane {
    /// How far a point x, y, z lies above it, m.
    pub fn above_m(&self, point: [f32; 3]) -> f64 {
        let [x, y, z] = point.map(f64::from);
        z - self.z_m - self.slope[0] * x - self.slope[1] * y
    }

    /// The plane that most points are near. The search covers slopes along x and along y of up to `slope_steps` steps of 0.05 to each side,
    /// and heights at the sensor in the range `z_m` in steps of `step_m`, m. `None` when fewer than 12 points agree.
    pub fn common(
        points: impl Iterator<Item = [f32; 3]> + Clone,
        slope_steps: i32,
        z_m: Range<f32>,
        step_m: f32,
    ) -> Option<GroundPlane> {
        let bins = (((z_m.end - z_m.start) / step_m) as usize).min(HEIGHTS_MAX);
        let mut best = (0u32, GroundPlane::default());
        let side = 2 * slope_steps + 1;
        for step in 0..side * side {
            let slope = [step % side, step / side].map(|s| (s - slope_steps) as f32 * SLOPE_STEP);
            let mut counts = [0u32; HEIGHTS_MAX];
            for [x, y, z] in points.clone() {
                let bin = (z - slope[0] * x - slope[1] * y - z_m.start) / step_m;
                if (0.0..bins as f32).contains(&bin) {
                    counts[bin as usize] += 1;
                }
            }
            // Neighbouring bins count together, because the ground is rough.
            for (bin, pair) in counts[..bins].windows(2).enumerate() {
                let count = pair[0] + pair[1];
                if count > best.0 {
                    let z_m = f64::from(z_m.start + (bin + 1) as f32 * step_m);
                    let slope = slope.map(f64::from);
                    best = (count, GroundPlane { z_m, slope });
                }
            }
        }
        (best.0 >= TILES_MIN).then_some(best.1)
    }

    /// Fits the plane by weighted least squares, starting at this plane: one pass per scale (m). `weight` takes a point's height above the last
    /// plane (m) and the scale (m). A slope of 1 costs as much as `slope_cost` points that are 1 m off.
    pub fn fitted(
        mut self,
        points: impl Iterator<Item = [f32; 3]> + Clone,
        scales_m: &[f64],
        weight: impl Fn(f64, f64) -> f64,
        slope_cost: f64,
    ) -> GroundPlane {
        for &scale_m in scales_m {
            let mut normal = Matrix3::from_diagonal(&Vector3::new(slope_cost, slope_cost, 1e-6));
            let mut right = Vector3::new(0.0, 0.0, 1e-6 * self.z_m);
            for point in points.clone() {
                let weight = weight(self.above_m(point), scale_m);
                let [x, y, z] = point.map(f64::from);
                let row = Vector3::new(x, y, 1.0);
                normal += weight * row * row.transpose();
                right += weight * z * row;
            }
            let Some(factors) = normal.cholesky() else {
                break;
            };
            let found = factors.solve(&right);
            (self.slope, self.z_m) = ([found[0], found[1]], found[2]);
        }
        self
    }
}
