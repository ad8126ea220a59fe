//! What a cluster's size says about it.

use crate::fit::ClusterPoints;

/// Whether a cluster is higher than it is long: a person, a pole. Parts of a vehicle that a short reach tears off are
/// as wide as they are high, or lower than a person.
pub(crate) fn is_upright(cluster: &ClusterPoints) -> bool {
    /// Higher than this by itself, m: above the ground's clearance.
    const HEIGHT_MIN_M: f64 = 1.0;
    const HEIGHT_PER_LENGTH: f64 = 1.3;
    /// One column of returns is no person: a wall seen at a flat angle falls apart into such, m.
    const WIDTH_MIN_M: f64 = 0.15;
    let height = height_m(cluster);
    height >= HEIGHT_MIN_M
        && longest_side(cluster).1 >= WIDTH_MIN_M
        && headings().all(|yaw| {
            let [a, b] = cluster.rectangle(yaw).size_m();
            a.max(b) * HEIGHT_PER_LENGTH <= height
        })
}

/// Whether some heading exists at which the cluster is no longer, wider and higher than l, w, h.
pub(crate) fn is_within(cluster: &ClusterPoints, [l, w, h]: [f64; 3]) -> bool {
    // No heading turns something longer than the diagonal into something that fits: this settles most walls.
    let is_too_long = |yaw: f64| {
        let [a, b] = cluster.rectangle(yaw).size_m();
        a.max(b) > l.hypot(w)
    };
    let eighth = std::f64::consts::FRAC_PI_4;
    if height_m(cluster) > h || is_too_long(0.0) || is_too_long(eighth) {
        return false;
    }
    headings().any(|yaw| {
        let [a, b] = cluster.rectangle(yaw).size_m();
        a.max(b) <= l && a.min(b) <= w
    })
}

/// Heading, rad, and length, m, of the longest side of any tight rectangle.
pub(crate) fn longest_side(cluster: &ClusterPoints) -> (f64, f64) {
    headings().fold((0.0, 0.0), |longest: (f64, f64), yaw| {
        let [u, v] = cluster.rectangle(yaw).size_m();
        [(yaw, u), (yaw + std::f64::consts::FRAC_PI_2, v)]
            .into_iter()
            .fold(longest, |a, b| if b.1 > a.1 { b } else { a })
    })
}

fn height_m(cluster: &ClusterPoints) -> f64 {
    let range = cluster.z_range_m();
    range.map_or(0.0, |[low, high]| f64::from(high - low))
}

/// Headings a step of 7.5 degrees apart.
fn headings() -> impl Iterator<Item = f64> {
    const COUNT: usize = 12;
    (0..COUNT).map(|step| std::f64::consts::FRAC_PI_2 * step as f64 / COUNT as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(l: f32, w: f32, h: f32, yaw_rad: f32) -> ClusterPoints {
        let mut points = ClusterPoints::default();
        let (sin, cos) = yaw_rad.sin_cos();
        for k in 0..8 {
            let side = |bit: i32, size: f32| {
                if k >> bit & 1 == 1 {
                    size / 2.0
                } else {
                    -size / 2.0
                }
            };
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
        assert!(
            !is_upright(&block(0.3, 0.3, 0.8, 0.0)),
            "lower than a person"
        );
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
