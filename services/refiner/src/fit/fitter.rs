//! Any of the fits, by name.
//!
//! Along the axes is what the paper's "tight box" says least ambiguously. On an L of points, which is what a sensor sees of a
//! car, the least area is often not the car's heading: it is kept as a reference beside [`super::Closeness`].

use super::{BoxFit, Closeness, ClusterPoints, Rectangle};

/// Lays rectangles; holds the buffers of the fits that need some.
#[derive(Debug, Default)]
pub struct Fitter {
    closeness: Closeness,
}

impl Fitter {
    /// The rectangle of a fit around points.
    pub fn fit(&mut self, fit: BoxFit, points: &ClusterPoints) -> Rectangle {
        match fit {
            BoxFit::AxisAligned => axis_aligned(points),
            BoxFit::MinimumArea => minimum_area(points),
            BoxFit::Closeness => self.closeness.fit(points),
        }
    }
}

/// The tight rectangle along x and y.
pub fn axis_aligned(points: &ClusterPoints) -> Rectangle {
    points.rectangle(0.0)
}

/// The tight rectangle of least area over headings one degree apart; the first heading wins a tie.
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
