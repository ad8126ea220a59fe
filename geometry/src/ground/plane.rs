//! The ground under a candidate: a plane through the lowest point of each 1 m cell around it.
//!
//! Cells whose lowest point lies on an object are outliers; four passes of least squares with a shrinking band around
//! the last plane leave them out. Measured on real scans this equals per-patch plane fitting over the whole frame for
//! our purpose, at 5 us a candidate.

use super::Lowest;

/// z = height_m + slope . (x, y - origin).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundPlane {
    /// Where `height_m` holds: x, y, m.
    pub origin_m: [f64; 2],
    /// z at the origin, m.
    pub height_m: f64,
    /// dz/dx and dz/dy.
    pub slope: [f64; 2],
}

/// Half widths of the bands around the last plane that a pass uses, m: first wide, for roads that slope.
const BANDS_M: [f64; 4] = [0.8, 0.4, 0.25, 0.2];
/// Fewer cells than this carry no plane.
const CELLS_MIN: usize = 8;
/// Steeper planes are walls or noise: |n_z| > 0.94, 20 degrees.
const SLOPE_MAX: f64 = 0.36;
/// The first plane lies flat at this share of the sorted cells: below most objects, above a few stray returns.
const START_QUANTILE: f64 = 0.25;
/// Lowest points of the cells within this distance carry the plane, m. 6 to 10 measure alike on simulated scans.
const RADIUS_M: f64 = 8.0;
/// Cells looked at: all of a circle of 8 m.
const CELLS_MAX: usize = 512;

impl GroundPlane {
    /// Flat ground `height_m` below the sensor.
    pub fn flat(center_m: [f64; 2], sensor_height_m: f64) -> GroundPlane {
        GroundPlane {
            origin_m: center_m,
            height_m: -sensor_height_m,
            slope: [0.0; 2],
        }
    }

    /// z of the ground, m.
    pub fn z_at_m(&self, x_m: f64, y_m: f64) -> f64 {
        self.height_m
            + self.slope[0] * (x_m - self.origin_m[0])
            + self.slope[1] * (y_m - self.origin_m[1])
    }

    /// Fits the ground around a centre; flat at the sensor's height where there is too little to go by.
    pub fn fit(lowest: &Lowest, center_m: [f64; 2], sensor_height_m: f64) -> GroundPlane {
        let found = GroundPlane::find(lowest, center_m);
        found.unwrap_or_else(|| GroundPlane::flat(center_m, sensor_height_m))
    }

    /// Fits the ground around a centre; `None` where there is too little to go by.
    pub fn find(lowest: &Lowest, center_m: [f64; 2]) -> Option<GroundPlane> {
        let mut cells = [[0.0; 3]; CELLS_MAX];
        let mut count = 0;
        for point in lowest.around(center_m, RADIUS_M) {
            let [x, y, z] = point.map(f64::from);
            let (dx, dy) = (x - center_m[0], y - center_m[1]);
            let near = dx * dx + dy * dy <= RADIUS_M * RADIUS_M;
            if near && count < CELLS_MAX {
                cells[count] = [dx, dy, z];
                count += 1;
            }
        }
        if count < CELLS_MIN {
            return None;
        }
        let cells = &mut cells[..count];
        let start = (count as f64 * START_QUANTILE) as usize;
        cells.select_nth_unstable_by(start, |a, b| a[2].total_cmp(&b[2]));
        let mut plane = GroundPlane {
            height_m: cells[start][2],
            ..GroundPlane::flat(center_m, 0.0)
        };
        // The selection above leaves an order that depends on nothing but the cells; sums stay reproducible.
        for band_m in BANDS_M {
            match least_squares(cells, &plane, band_m) {
                Some(better) => plane = better,
                None => break,
            }
        }
        Some(plane)
    }
}

/// The plane through the cells within a band around the last one; `None` when they carry none.
fn least_squares(cells: &[[f64; 3]], last: &GroundPlane, band_m: f64) -> Option<GroundPlane> {
    // Of dx, dy and 1 with each other, and with z.
    let (mut xx, mut xy, mut x1, mut yy, mut y1) = (0.0, 0.0, 0.0, 0.0, 0.0);
    let mut right = [0.0; 3];
    let mut used = 0;
    for &[dx, dy, z] in cells {
        let above_m = z - last.height_m - last.slope[0] * dx - last.slope[1] * dy;
        if above_m.abs() <= band_m {
            xx += dx * dx;
            xy += dx * dy;
            x1 += dx;
            yy += dy * dy;
            y1 += dy;
            right[0] += dx * z;
            right[1] += dy * z;
            right[2] += z;
            used += 1;
        }
    }
    if used < CELLS_MIN {
        return None;
    }
    let normal = nalgebra::Matrix3::new(xx, xy, x1, xy, yy, y1, x1, y1, used as f64);
    let solution = normal.cholesky()?.solve(&nalgebra::Vector3::from(right));
    let slope = [solution[0], solution[1]];
    let fine = slope[0].hypot(slope[1]) <= SLOPE_MAX && solution[2].is_finite();
    fine.then_some(GroundPlane {
        origin_m: last.origin_m,
        height_m: solution[2],
        slope,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lowest(points: impl IntoIterator<Item = [f32; 3]>) -> Lowest {
        let mut lowest = Lowest::default();
        lowest.add(points.into_iter());
        lowest
    }

    #[test]
    fn a_sloping_road_is_found_under_a_block() {
        // It rises 5 % ahead and 2 % to the left.
        let scan = (0..100 * 100).map(|i| {
            let (x, y) = (10.0 + 0.2 * (i / 100) as f32, 0.2 * (i % 100) as f32 - 10.0);
            let z = -1.7 + 0.05 * (x - 20.0) + 0.02 * y;
            let on_block = (18.0..22.0).contains(&x) && (-1.0..1.0).contains(&y);
            [x, y, if on_block { z + 1.5 } else { z }]
        });
        let plane = GroundPlane::fit(&lowest(scan), [20.0, 0.0], 1.73);
        // The lowest point of a cell on a slope is its lower edge: the plane goes through those.
        assert!((plane.height_m + 1.7).abs() < 0.03, "{plane:?}");
        assert!((plane.slope[0] - 0.05).abs() < 0.005 && (plane.slope[1] - 0.02).abs() < 0.005);
        assert!((plane.z_at_m(22.0, 1.0) - (-1.58)).abs() < 0.04);
    }

    #[test]
    fn nothing_to_go_by_means_flat_ground_at_the_sensors_height() {
        for scan in [vec![], vec![[20.0, 0.0, 3.0]; 5000]] {
            let plane = GroundPlane::fit(&lowest(scan), [20.0, 0.0], 1.5);
            assert_eq!(plane, GroundPlane::flat([20.0, 0.0], 1.5));
        }
    }

    #[test]
    fn a_wall_is_no_ground() {
        let wall = (0..2000).map(|i| [12.0 + 0.008 * i as f32, 0.5, (i % 40) as f32 * 0.1]);
        let plane = GroundPlane::fit(&lowest(wall), [20.0, 0.0], 1.73);
        assert!(plane.slope[0].hypot(plane.slope[1]) <= SLOPE_MAX && plane.height_m.is_finite());
    }
}
