//! Decisions by a cluster's size.

use crate::fit::ClusterPoints;
use crate::priors::{LOW_M, TALL_FROM_M, TALL_M};
use std::sync::LazyLock;

/// Whether a cluster is no larger than one object can be.
pub(crate) fn is_whole(cluster: &ClusterPoints) -> bool {
    let is_tall = height_m(cluster) >= TALL_FROM_M;
    is_within(cluster, if is_tall { TALL_M } else { LOW_M })
}

/// A cluster longer than this along any direction is not whole, m.
pub(crate) fn whole_diagonal_m() -> f64 {
    let diagonal = |[l, w, _]: [f64; 3]| l.hypot(w);
    diagonal(LOW_M).max(diagonal(TALL_M))
}

/// Whether a cluster is higher than it is long: a person, a pole. Parts that a short join distance separates from a
/// vehicle are as wide as they are high, or lower than a person.
pub(crate) fn is_upright(cluster: &ClusterPoints) -> bool {
    /// Minimum height of the cluster itself, m, above the ground's clearance.
    const HEIGHT_MIN_M: f64 = 1.0;
    const HEIGHT_PER_LENGTH: f64 = 1.3;
    /// Minimum width, m: one column of returns is no person; a wall seen at a flat angle divides into such columns.
    const WIDTH_MIN_M: f64 = 0.15;
    let height = height_m(cluster);
    if height < HEIGHT_MIN_M {
        return false;
    }
    let limit_m = height / HEIGHT_PER_LENGTH;
    let widest_m = |direction: &[f32; 2]| {
        let [a, b] = cluster.sides_m(*direction);
        a.max(b)
    };
    let octagon_m = widest_m(&DIRECTIONS[0]).max(widest_m(&DIRECTIONS[COUNT / 2]));
    if octagon_m > limit_m || octagon_m < WIDTH_MIN_M {
        return false;
    }
    // Between two of the octagon's directions the cluster is not wider than this.
    octagon_m / OCTAGON <= limit_m || DIRECTIONS.iter().all(|d| widest_m(d) <= limit_m)
}

/// Whether a heading exists at which the cluster is no longer, wider or higher than l, w, h, m.
pub(crate) fn is_within(cluster: &ClusterPoints, [l, w, h]: [f64; 3]) -> bool {
    if height_m(cluster) > h {
        return false;
    }
    let fits = |[a, b]: [f64; 2]| a.max(b) <= l && a.min(b) <= w;
    // A cluster longer than the diagonal fits at no heading: this rejects most walls.
    let is_too_long = |[a, b]: [f64; 2]| a.max(b) > l.hypot(w);
    for middle in [DIRECTIONS[0], DIRECTIONS[COUNT / 2]] {
        let sides_m = cluster.sides_m(middle);
        if fits(sides_m) {
            return true;
        }
        if is_too_long(sides_m) {
            return false;
        }
    }
    DIRECTIONS.iter().any(|&d| fits(cluster.sides_m(d)))
}

/// Heading, rad, and length, m, of the longest side of any tight rectangle.
pub(crate) fn longest_side(cluster: &ClusterPoints) -> (f64, f64) {
    let mut longest = (0.0, 0.0);
    for (step, direction) in DIRECTIONS.iter().enumerate() {
        let yaw_rad = cluster.ahead_rad + heading_rad(step);
        let [u, v] = cluster.sides_m(*direction);
        for side in [(yaw_rad, u), (yaw_rad + std::f64::consts::FRAC_PI_2, v)] {
            if side.1 > longest.1 {
                longest = side;
            }
        }
    }
    longest
}

fn height_m(cluster: &ClusterPoints) -> f64 {
    cluster.z_range_m().map_or(0.0, |[low, high]| f64::from(high - low))
}

/// Number of headings within a quarter turn.
const COUNT: usize = 12;
/// cos(22.5 degrees): of two directions 45 degrees apart, the larger width is at least this share of any width between them.
const OCTAGON: f64 = 0.923_879;

/// Headings 7.5 degrees apart, rad from the line of sight.
fn heading_rad(step: usize) -> f64 {
    std::f64::consts::FRAC_PI_2 * step as f64 / COUNT as f64
}

/// The same headings as directions (cosine, sine), seen from above.
static DIRECTIONS: LazyLock<[[f32; 2]; COUNT]> = LazyLock::new(|| {
    std::array::from_fn(|step| {
        let yaw_rad = heading_rad(step);
        [yaw_rad.cos() as f32, yaw_rad.sin() as f32]
    })
});

#[cfg(test)]
mod tests {
    use super::*;

    fn block(l: f32, w: f32, h: f32, yaw_rad: f32) -> ClusterPoints {
        let mut points = ClusterPoints::default();
        let (sin, cos) = yaw_rad.sin_cos();
        for k in 0..8 {
            let side = |bit: i32, size: f32| size * ((k >> bit & 1) as f32 - 0.5);
            let (u, v) = (side(0, l), side(1, w));
            points.push(u * cos - v * sin, u * sin + v * cos, side(2, h));
        }
        points
    }

    #[test]
    fn a_person_stands_upright_and_a_car_does_not() {
        assert!(is_upright(&block(0.6, 0.5, 1.7, 0.4)));
        assert!(!is_upright(&block(4.0, 1.7, 1.5, 0.4)));
        assert!(!is_upright(&block(0.1, 0.1, 1.8, 0.0)), "one column");
        let low = block(0.3, 0.3, 0.8, 0.0);
        assert!(!is_upright(&low), "lower than a person");
    }

    #[test]
    fn a_van_is_within_at_any_heading_and_a_wall_at_none() {
        let limit = [7.0, 2.8, 4.0];
        for degrees in 0..90 {
            let yaw = f64::from(degrees).to_radians() as f32;
            assert!(is_within(&block(6.0, 2.0, 2.5, yaw), limit));
            assert!(!is_within(&block(9.0, 0.3, 2.5, yaw), limit));
            assert!(!is_within(&block(5.0, 4.0, 2.5, yaw), limit));
            assert!(!is_within(&block(2.0, 2.0, 4.5, yaw), limit));
        }
    }
}
