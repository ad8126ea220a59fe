//! The tight rectangle of least area, over headings one degree apart.
//!
//! On an L of points, which is what a sensor sees of a car, the least area is often not the car's heading: this is kept
//! as a reference beside [`super::Closeness`].

use super::{ClusterPoints, Rectangle};

/// The tight rectangle of least area; the first heading wins a tie.
pub fn minimum_area(points: &ClusterPoints) -> Rectangle {
    let area = |r: &Rectangle| r.size_m()[0] * r.size_m()[1];
    let at = |degrees: i32| points.rectangle(points.ahead_rad() + f64::from(degrees).to_radians());
    let mut best = at(0);
    for rectangle in (1..90).map(at) {
        if area(&rectangle) < area(&best) {
            best = rectangle;
        }
    }
    best
}
