//! L-shape fit by closeness (Zhang, Xu, Dong and Dolan, "Efficient L-shape fitting for vehicle detection", 2017).
//!
//! Over headings of 0 to 89 degrees: maximise the sum over the points of 1 / max(d, 3 cm), d the distance to the nearest
//! side of the tight rectangle. First every third degree, then the degrees beside the best. The sum is taken in whole
//! numbers, so that it does not depend on the order of the points.

use std::sync::LazyLock;

use mluc_kernels::at_best;

use super::{ClusterPoints, LANES, Rectangle};

/// Distances below this count the same, m: the sensor's noise.
const NEAREST_M: f32 = 0.03;
/// Terms are rounded to 1/1024 of 1/m before they are added.
const STEPS: f32 = 1024.0;
/// Adding 2^23 leaves a float's whole part in its low bits.
const WHOLE: f32 = 8_388_608.0;
/// Larger clusters are thinned to about this many points for the heading alone,
const HEADING_POINTS_MAX: usize = 512;
/// and to about this many while every third degree is tried.
const COARSE_POINTS_MAX: usize = 192;
/// Whole degrees within a quarter turn.
const DEGREES: usize = 90;
/// Headings that are tried first.
const COARSE: usize = DEGREES / 3;

/// Cosine and sine of every whole degree.
static DIRECTIONS: LazyLock<[[f32; 2]; DEGREES]> = LazyLock::new(|| {
    std::array::from_fn(|degrees| {
        let (sin, cos) = (degrees as f64).to_radians().sin_cos();
        [cos as f32, sin as f32]
    })
});

/// The closeness fit; holds its buffers.
#[derive(Debug, Default)]
pub struct Closeness {
    x_m: Vec<f32>,
    y_m: Vec<f32>,
}

impl Closeness {
    /// The rectangle that the points lie closest to.
    pub fn fit(&mut self, points: &ClusterPoints) -> Rectangle {
        self.thin(points, COARSE_POINTS_MAX);
        let coarse = std::array::from_fn::<i32, COARSE, _>(|step| 3 * step as i32);
        let coarse = at_best(
            #[inline(always)]
            || self.best(coarse),
        );
        self.thin(points, HEADING_POINTS_MAX);
        let fine = [0, -1, 1, -2, 2].map(|step| coarse + step);
        let fine = at_best(
            #[inline(always)]
            || self.best(fine),
        );
        points.rectangle(f64::from(fine.rem_euclid(DEGREES as i32)).to_radians())
    }

    /// The first of equals, in the order given.
    #[inline(always)]
    fn best<const COUNT: usize>(&self, degrees: [i32; COUNT]) -> i32 {
        let (mut most, mut best) = (0, 0);
        for d in degrees {
            let found = self.score(d);
            if found > most {
                (most, best) = (found, d);
            }
        }
        best
    }

    /// A point stays or goes by its coordinates alone. Equal points stay or go together, so their number is bounded by
    /// the candidate's own limit; a lane's sum holds 120,000 terms.
    fn thin(&mut self, points: &ClusterPoints, points_max: usize) {
        let keep_one_in = points.len().div_ceil(points_max) as u32;
        self.x_m.clear();
        self.y_m.clear();
        if keep_one_in <= 1 {
            self.x_m.extend_from_slice(&points.x_m);
            self.y_m.extend_from_slice(&points.y_m);
            return;
        }
        self.x_m.resize(points.len(), 0.0);
        self.y_m.resize(points.len(), 0.0);
        // Whether a number of 16 bits is a multiple, without a division (Lemire, Kaser and Kurz, "Faster remainder by
        // direct computation", 2019).
        let share = u32::MAX / keep_one_in + 1;
        let mut kept = 0;
        for (&x, &y) in points.x_m.iter().zip(&points.y_m) {
            let mixed = (x.to_bits() ^ y.to_bits().rotate_left(16)).wrapping_mul(0x9E37_79B9);
            // The next one takes the place of one that goes.
            (self.x_m[kept], self.y_m[kept]) = (x, y);
            kept += usize::from((mixed >> 16).wrapping_mul(share) < share);
        }
        self.x_m.truncate(kept);
        self.y_m.truncate(kept);
    }

    #[inline(always)]
    fn score(&self, degrees: i32) -> u64 {
        let [cos, sin] = DIRECTIONS[degrees.rem_euclid(DEGREES as i32) as usize];
        let [u, v] = super::spans(&self.x_m, &self.y_m, [cos, sin]);
        let term = |x: f32, y: f32| {
            let (a, b) = (x * cos + y * sin, y * cos - x * sin);
            let least = |p: f32, q: f32| if p < q { p } else { q };
            let du = least(a - u[0], u[1] - a);
            let dv = least(b - v[0], v[1] - b);
            let d = least(du, dv);
            let d = if d > NEAREST_M { d } else { NEAREST_M };
            (STEPS / d + WHOLE).to_bits() & 0x7F_FFFF
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
            let (u, v) = match i <= 40 {
                true => (f64::from(i) * 0.1, 0.0),
                false => (0.0, f64::from(i - 40) * 0.05),
            };
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
            assert!(off.min(90.0 - off) < 1.01, "{tenths}: off by {off}");
        }
    }

    #[test]
    fn the_order_of_points_does_not_matter() {
        let points = corner(0.4);
        let mut turned = ClusterPoints::default();
        for i in (0..points.len()).rev() {
            turned.push(points.x_m[i], points.y_m[i], 0.0);
        }
        let mut closeness = Closeness::default();
        assert_eq!(closeness.fit(&points), closeness.fit(&turned));
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
