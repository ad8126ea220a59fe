//! L-shape fit by closeness (Zhang, Xu, Dong and Dolan, "Efficient L-shape fitting for vehicle detection", 2017).
//!
//! Over headings of 0 to 90 degrees from the line of sight: maximise the sum over the points of 1 / max(d, 3 cm), d the
//! distance to the nearest side of the tight rectangle. First every third degree is tried, then the degrees near the best,
//! then thirds of a degree. The sum is taken in whole numbers, so that it does not depend on the order of the points.

use super::{ClusterPoints, LANES, Rectangle, higher, lower, spans};
use mluc_kernels::at_best;
use std::sync::LazyLock;

/// Distances below this count as equal, m: the sensor's noise.
const NEAREST_M: f32 = 0.03;
/// Terms are rounded to 1/1024 of 1/m before they are added.
const STEPS: f32 = 1024.0;
/// Adding 2^23 leaves a float's whole part in its low bits.
const WHOLE: f32 = 8_388_608.0;
/// Larger clusters are thinned to about this many points for the heading alone.
const HEADING_POINTS_MAX: usize = 512;
/// They are thinned to about this many points while every third degree is tried.
const COARSE_POINTS_MAX: usize = 192;
/// Resolution of coordinates when points are thinned, 1/m: the rounding error after a turn of the scene is far smaller.
const PLACES: f32 = 16.0;
/// Number of headings within a quarter turn, a third of a degree apart.
const HEADINGS: usize = 270;
const DEGREE: i32 = 3;
/// Number of headings that are tried first, three degrees apart.
const COARSE: usize = 30;

static DIRECTIONS: LazyLock<[[f32; 2]; HEADINGS]> = LazyLock::new(|| {
    std::array::from_fn(|step| {
        let (sin, cos) = angle_rad(step as i32).sin_cos();
        [cos as f32, sin as f32]
    })
});

fn angle_rad(step: i32) -> f64 {
    (f64::from(step) / f64::from(DEGREE)).to_radians()
}

/// The closeness fit, with its buffers.
#[derive(Debug, Default)]
pub struct Closeness {
    /// Coordinates along the line of sight, m.
    x_m: Vec<f32>,
    /// Coordinates across the line of sight, m.
    y_m: Vec<f32>,
}

impl Closeness {
    /// The rectangle to whose sides the points are closest.
    pub fn fit(&mut self, points: &ClusterPoints) -> Rectangle {
        self.thin(points, COARSE_POINTS_MAX);
        let coarse = std::array::from_fn::<i32, COARSE, _>(|step| 3 * DEGREE * step as i32);
        let coarse = at_best!(self.best(coarse));
        if points.len() > COARSE_POINTS_MAX {
            self.thin(points, HEADING_POINTS_MAX);
        }
        let beside = [0, -1, 1, -2, 2];
        let fine = beside.map(|step| coarse + DEGREE * step);
        let finest = at_best!({
            let fine = self.best(fine);
            self.best(beside.map(|step| fine + step))
        });
        points.rectangle(points.ahead_rad + angle_rad(finest))
    }

    /// The best step; the first of equals, in the given order.
    #[inline(always)]
    fn best<const COUNT: usize>(&self, steps: [i32; COUNT]) -> i32 {
        let (mut most, mut best) = (0, 0);
        for step in steps {
            let found = self.score(step);
            if found > most {
                (most, best) = (found, step);
            }
        }
        best
    }

    /// Copies the points in coordinates of the line of sight, at most about `points_max`.
    ///
    /// Whether a point is kept depends on these coordinates alone. Equal points are kept or dropped together, so their
    /// number is bounded by the candidate's own limit; a lane's sum has room for 120,000 terms.
    fn thin(&mut self, points: &ClusterPoints, points_max: usize) {
        let [cos, sin] = points.ahead;
        let keep_one_in = points.len().div_ceil(points_max) as u32;
        // Whether a 16-bit number is a multiple, without a division (Lemire, Kaser and Kurz, "Faster remainder by direct computation", 2019).
        let share = (u32::MAX / keep_one_in.max(1)).wrapping_add(1);
        self.x_m.resize(points.len(), 0.0);
        self.y_m.resize(points.len(), 0.0);
        let mut kept = 0;
        for ((&x, &y), &z) in points.x_m.iter().zip(&points.y_m).zip(&points.z_m) {
            let (along, across) = (x * cos + y * sin, y * cos - x * sin);
            let place = |m: f32| (m * PLACES + WHOLE).to_bits();
            let mixed =
                (z.to_bits() ^ place(along).rotate_left(11) ^ place(across).rotate_left(21))
                    .wrapping_mul(0x9E37_79B9);
            // The next point overwrites a dropped one.
            (self.x_m[kept], self.y_m[kept]) = (along, across);
            let stays = (keep_one_in <= 1) | ((mixed >> 16).wrapping_mul(share) < share);
            kept += usize::from(stays);
        }
        self.x_m.truncate(kept);
        self.y_m.truncate(kept);
    }

    #[inline(always)]
    fn score(&self, step: i32) -> u64 {
        let [cos, sin] = DIRECTIONS[step.rem_euclid(HEADINGS as i32) as usize];
        let [u, v] = spans(&self.x_m, &self.y_m, [cos, sin]);
        let term = |x: f32, y: f32| {
            let (a, b) = (x * cos + y * sin, y * cos - x * sin);
            let d = lower(lower(a - u[0], u[1] - a), lower(b - v[0], v[1] - b));
            (STEPS / higher(d, NEAREST_M) + WHOLE).to_bits() & 0x7F_FFFF
        };
        let mut sums = [0u32; LANES];
        let (x, y) = (self.x_m.chunks_exact(LANES), self.y_m.chunks_exact(LANES));
        for (&px, &py) in x.remainder().iter().zip(y.remainder()) {
            sums[0] += term(px, py);
        }
        for (px, py) in x.zip(y) {
            for lane in 0..LANES {
                sums[lane] += term(px[lane], py[lane]);
            }
        }
        sums.iter().map(|&s| u64::from(s)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two sides of a rectangle of 4 m by 2 m that is turned.
    fn corner(yaw_rad: f64) -> ClusterPoints {
        let (sin, cos) = yaw_rad.sin_cos();
        let mut points = ClusterPoints::default();
        for i in 0..=80 {
            let (u, v) =
                if i <= 40 { (f64::from(i) * 0.1, 0.0) } else { (0.0, f64::from(i - 40) * 0.05) };
            points.push((u * cos - v * sin) as f32, (u * sin + v * cos) as f32, 0.0);
        }
        points
    }

    #[test]
    fn an_l_of_points_is_found_at_any_heading() {
        let mut closeness = Closeness::default();
        for tenths in 0..900 {
            let yaw = f64::from(tenths).to_radians() / 10.0;
            let found = closeness.fit(&corner(yaw));
            let off = (found.yaw_rad - yaw).to_degrees().rem_euclid(90.0);
            assert!(off.min(90.0 - off) < 0.67, "{tenths}: off by {off}");
        }
    }

    #[test]
    fn equal_points_and_one_point_give_a_rectangle_of_no_size() {
        let mut closeness = Closeness::default();
        for count in [1, 5, 9, 3000] {
            let mut points = ClusterPoints::default();
            (0..count).for_each(|_| points.push(1.0, 2.0, 0.0));
            let size = closeness.fit(&points).size_m();
            assert!(size[0].abs() < 1e-6 && size[1].abs() < 1e-6);
        }
    }
}
