//! The tight rectangle of least area, over headings one degree apart.
//!
//! On an L of points, which is what a sensor sees of a car, the least area is often not the car's heading: this is kept
//! as a reference beside [`super::Closeness`].

use super::{ClusterPoints, Rectangle};

/// The tight rectangle of least area; the first heading wins a tie.
pub fn minimum_area(points: &ClusterPoints) -> Rectangle {
    let area = |r: &Rectangle| r.size_m()[0] * r.size_m()[1];
    let mut best = points.rectangle(0.0);
    for degrees in 1..90 {
        let rectangle = points.rectangle(f64::from(degrees).to_radians());
        if area(&rectangle) < area(&best) {
            best = rectangle;
        }
    }
    best
}
