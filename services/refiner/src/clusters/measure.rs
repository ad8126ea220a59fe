//! Measurements of a cluster, for a classifier that separates objects from clutter.
//!
//! Sums are taken in whole millimetres, so that they do not depend on the order of the points.

use crate::fit::{ClusterPoints, Rectangle, higher, lower};
use crate::{Sensor, frame::IndexedPoint};
use mluc_geometry::ground::{ground_height_m, tiles::whole};
use mluc_kernels::at_best;
use nalgebra::{Matrix3, Vector3};

/// Maximum assumed height of an object above its seen top, m. A guess, as the gap itself is if the model has no beams.
const GAP_MAX_M: f32 = 0.5;

/// Measurements of one cluster, as the sensor saw it, without completed parts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Measures {
    /// Number of points.
    pub points: u32,
    /// Distance from the sensor's axis to the mean of its points, m.
    pub range_m: f32,
    /// Distance between two beams at its range, m, at most 0.5: its top may be this much higher. If the model has no beams, for HDL-64E columns.
    pub beam_gap_m: f32,
    /// Length and width (of the tight rectangle) and height of the seen part, m.
    pub seen_m: [f32; 3],
    /// Height of its lowest point above the ground, m.
    pub bottom_m: f32,
    /// Height of its highest point above the ground, m.
    pub top_m: f32,
    /// (l1 - l2) / l1 of the eigenvalues of the points' covariance, l1 the largest: 1 for a line.
    pub linearity: f32,
    /// (l2 - l3) / l1: 1 for a disc.
    pub planarity: f32,
    /// l3 / l1: 1 for a ball.
    pub scattering: f32,
    /// Mean distance of the points to the nearest side of the tight rectangle, m: small for a vehicle's body.
    pub residual_m: f32,
    /// Number of points divided by the number that a solid face of its width and height would return, 0 to 10.
    pub density: f32,
    /// Longest side along x or y of the component that it was divided from, m: long for parts of walls and hedges.
    pub component_length_m: f32,
    /// Whether it was cut from something longer than any road user.
    pub is_cut: bool,
}

/// The steps between the sensor's rays.
#[derive(Debug)]
pub(super) struct Measurer {
    /// Step between columns and between beams, rad.
    steps_rad: [f32; 2],
    /// Whether the model gives the steps.
    is_given: bool,
}

/// HDL-64E at 10 Hz, rad: 0.1728 degrees between columns, 26.8 degrees over 64 beams.
const STEPS_DEFAULT_RAD: [f32; 2] = [0.003_015_929, 0.007_425];
/// Without beams in the model, returns are counted between these elevations (tangents of -8 and -2 degrees), where hardly a ray is lost. Fewer
/// than `COUNTED_MIN` are too few.
const BAND: [f32; 2] = [-0.1405, -0.0349];
const COUNTED_MIN: u32 = 480;
/// Directions are distinguished by octant and by the ratio of the shorter side to the longer one, in this many steps.
const RATIOS: u32 = 4;
const DENSITY_MAX: f32 = 10.0;
/// Bounds of [`Measurer::spread`].
const SPREAD: [f32; 2] = [0.5, 2.5];
const PER_M: f32 = 1000.0;

impl Measurer {
    pub(super) fn new(sensor: &Sensor) -> Measurer {
        let mut steps_rad = STEPS_DEFAULT_RAD;
        if let Some(beams) = &sensor.beams {
            steps_rad[0] = beams.azimuth_step_rad;
            if let [first, .., last] = beams.elevation_rad[..]
                && first > last
            {
                steps_rad[1] = (first - last) / (beams.elevation_rad.len() as f32 - 1.0);
            }
        }
        Measurer { steps_rad, is_given: sensor.beams.is_some() }
    }

    /// Estimates the step between the beams of a scan, with the columns of an HDL-64E: only the product of both steps counts.
    pub(super) fn look(&mut self, points: &[IndexedPoint]) {
        if self.is_given {
            return;
        }
        let (mut count, mut seen) = (0u32, 0u32);
        for point in points {
            let [x, y, z] = point.at_m;
            let distance = (x * x + y * y).sqrt();
            if z > BAND[0] * distance && z < BAND[1] * distance {
                let [short, long] = [x.abs().min(y.abs()), x.abs().max(y.abs())];
                let octant =
                    u32::from(x > 0.0) + 2 * u32::from(y > 0.0) + 4 * u32::from(x.abs() > y.abs());
                let ratio = ((short / long * RATIOS as f32) as u32).min(RATIOS - 1);
                seen |= 1 << (octant * RATIOS + ratio);
                count += 1;
            }
        }
        self.steps_rad = STEPS_DEFAULT_RAD;
        if count >= COUNTED_MIN {
            let seen_rad = std::f32::consts::TAU * seen.count_ones() as f32 / u32::BITS as f32;
            self.steps_rad[1] = (BAND[1] - BAND[0]) * seen_rad / (count as f32 * self.steps_rad[0]);
        }
    }

    /// Distance between neighbouring rays, the root of the area of one, as a multiple of an HDL-64E's.
    pub(super) fn spread(&self) -> f32 {
        let area = |[column, beam]: [f32; 2]| column * beam;
        let ratio = area(self.steps_rad) / area(STEPS_DEFAULT_RAD);
        ratio.sqrt().clamp(SPREAD[0], SPREAD[1])
    }

    /// Measures a cluster; the caller adds what it was divided from.
    pub(super) fn measure(
        &self,
        points: &ClusterPoints,
        tight: &Rectangle,
        ground_m: &[f32],
    ) -> Measures {
        let Some([low, high]) = points.z_range_m() else {
            return Measures::default();
        };
        let origin_m = points.origin_m;
        let range_m = origin_m[0].hypot(origin_m[1]);
        let [u, v] = tight.size_m().map(|side| side as f32);
        let floor = ground_height_m(ground_m, origin_m.map(|v| v as f32));
        let [linearity, planarity, scattering] = eigen_features(points);
        Measures {
            points: points.len() as u32,
            range_m: range_m as f32,
            beam_gap_m: (range_m as f32 * self.steps_rad[1]).min(GAP_MAX_M),
            seen_m: [u.max(v), u.min(v), high - low],
            bottom_m: low - floor,
            top_m: high - floor,
            linearity,
            planarity,
            scattering,
            residual_m: residual_m(points, tight),
            density: self.density(points, high - low),
            ..Measures::default()
        }
    }

    fn density(&self, points: &ClusterPoints, height_m: f32) -> f32 {
        let origin_m = points.origin_m;
        let range = origin_m[0].hypot(origin_m[1]).max(1.0);
        let across = [(-origin_m[1] / range) as f32, (origin_m[0] / range) as f32];
        let [low, high] = points.span_m(across);
        let [column_m, beam_m] = self.steps_rad.map(|step| range as f32 * step);
        let columns = (high - low) / column_m + 1.0;
        let rows = height_m / beam_m + 1.0;
        (points.len() as f32 / (columns * rows)).min(DENSITY_MAX)
    }
}

/// Linearity, planarity and scattering.
fn eigen_features(points: &ClusterPoints) -> [f32; 3] {
    let (sum, products) = at_best!(sums(points));
    let n = points.len().max(1) as f64;
    let mean = Vector3::from(sum.map(|s| s as f64 / n));
    let [xx, xy, xz, yy, yz, zz] = products.map(|p| p as f64 / n);
    let squares = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    let values = (squares - mean * mean.transpose()).symmetric_eigenvalues();
    let mut l = [values[0], values[1], values[2]].map(|v| v.max(0.0));
    l.sort_unstable_by(|a, b| b.total_cmp(a));
    if l[0] <= 0.0 {
        return [0.0; 3];
    }
    [(l[0] - l[1]) / l[0], (l[1] - l[2]) / l[0], l[2] / l[0]].map(|v| v as f32)
}

/// Sums of x, y, z and of xx, xy, xz, yy, yz, zz, in whole millimetres; z relative to the first point.
#[inline(always)]
fn sums(points: &ClusterPoints) -> ([i64; 3], [i64; 6]) {
    let mut sum = [0i64; 3];
    let mut products = [0i64; 6];
    // Operations that the compiler can vectorize: adding 1.5 x 2^23 moves a whole number, up to 4 km, into the low bits. Products have 64 bits.
    let whole =
        |v: f32| ((v * PER_M).trunc() + 12_582_912.0).to_bits().wrapping_sub(0x4B40_0000) as i32;
    let base = points.z_m.first().map_or(0, |&z| whole(z));
    for ((&x, &y), &z) in points.x_m.iter().zip(&points.y_m).zip(&points.z_m) {
        let [x, y, z] = [whole(x), whole(y), whole(z).wrapping_sub(base)].map(i64::from);
        let pairs = [x * x, x * y, x * z, y * y, y * z, z * z];
        for (sum, v) in sum.iter_mut().zip([x, y, z]) {
            *sum += v;
        }
        for (product, v) in products.iter_mut().zip(pairs) {
            *product += v;
        }
    }
    (sum, products)
}

fn residual_m(points: &ClusterPoints, tight: &Rectangle) -> f32 {
    let (sin, cos) = (tight.yaw_rad.sin() as f32, tight.yaw_rad.cos() as f32);
    let [u, v] = tight.sides_m.map(|side| side.map(|m| m as f32));
    let whole_mm = |(x, y): (&f32, &f32)| {
        let (a, b) = (x * cos + y * sin, y * cos - x * sin);
        let d = lower(lower(a - u[0], u[1] - a), lower(b - v[0], v[1] - b));
        u64::from(whole(higher(d, 0.0) * PER_M))
    };
    let sum: u64 = at_best!(points.x_m.iter().zip(&points.y_m).map(whole_mm).sum());
    sum as f32 / points.len().max(1) as f32 / PER_M
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_geometry::ground::GROUND_NODES;

    fn measured(points: &ClusterPoints) -> Measures {
        let measurer = Measurer::new(&Sensor::plain(&["car"]));
        measurer.measure(points, &points.rectangle(0.0), &[-1.7; GROUND_NODES])
    }

    /// A cluster 20 m ahead, without points.
    fn started() -> ClusterPoints {
        let mut points = ClusterPoints::default();
        points.start([20.0, 0.0]);
        points
    }

    fn grid(l: usize, w: usize, h: usize) -> ClusterPoints {
        let mut points = started();
        for i in 0..l * w * h {
            let at = [i % l, i / l % w, i / l / w].map(|k| k as f32 * 0.1);
            points.push(at[0], at[1], at[2] - 1.5);
        }
        points
    }

    #[test]
    fn a_line_a_wall_and_a_block_are_told_apart() {
        let line = measured(&grid(30, 1, 1));
        assert!(line.linearity > 0.99, "{line:?}");
        let wall = measured(&grid(1, 30, 30));
        assert!(wall.planarity > 0.95 && wall.residual_m < 0.01, "{wall:?}");
        let block = measured(&grid(10, 10, 10));
        assert!(block.scattering > 0.95 && block.residual_m > 0.1, "{block:?}");
        assert_eq!(measured(&started()).points, 0);
    }

    #[test]
    fn heights_are_above_the_ground() {
        let wall = measured(&grid(1, 30, 11));
        assert!((wall.bottom_m - 0.2).abs() < 1e-5 && (wall.top_m - 1.2).abs() < 1e-5);
        assert!((wall.seen_m[0] - 2.9).abs() < 1e-5 && (wall.seen_m[2] - 1.0).abs() < 1e-5);
        assert_eq!(wall.beam_gap_m, 20.0 * STEPS_DEFAULT_RAD[1]);
    }

    #[test]
    fn the_spacing_of_beams_is_found_in_the_scan() {
        // Beams 2 degrees apart, all around or ahead, with the columns of an HDL-64E.
        let found_deg = |columns: usize| {
            let at = |n: usize| {
                let azimuth = (n / 15) as f32 * STEPS_DEFAULT_RAD[0] - 0.5;
                let tan = (1.0 - 2.0 * (n % 15) as f32).to_radians().tan();
                IndexedPoint {
                    at_m: [azimuth.cos() * 20.0, azimuth.sin() * 20.0, tan * 20.0],
                    index: n as u32,
                }
            };
            let mut measurer = Measurer::new(&Sensor::plain(&["car"]));
            measurer.look(&(0..15 * columns).map(at).collect::<Vec<_>>());
            // The join distance grows with the root of it.
            let spread = (measurer.steps_rad[1] / STEPS_DEFAULT_RAD[1]).sqrt();
            assert!((measurer.spread() - spread).abs() < 1e-5);
            measurer.steps_rad[1].to_degrees()
        };
        let [around, none] = [2083, 0].map(found_deg);
        assert!((around - 2.0).abs() < 0.1, "{around}");
        assert_eq!(none, STEPS_DEFAULT_RAD[1].to_degrees());
        let ahead = found_deg(521);
        assert!((ahead - 2.0).abs() < 0.5, "{ahead}");
    }

    #[test]
    fn a_face_seen_beam_by_beam_has_a_density_of_about_one() {
        let [az, el] = STEPS_DEFAULT_RAD;
        let mut points = started();
        for i in 0..30 {
            for k in 0..20 {
                points.push(0.0, 20.0 * az * i as f32, 20.0 * el * k as f32 - 1.5);
            }
        }
        let density = measured(&points).density;
        assert!((density - 1.0).abs() < 0.1, "{density}");
    }
}
