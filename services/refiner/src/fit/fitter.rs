//! Any of the fits, by name.

use super::{BoxFit, Closeness, ClusterPoints, Rectangle, axis_aligned, minimum_area};

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
