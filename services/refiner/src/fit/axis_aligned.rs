//! Sides along the sensor's axes: what the paper's "tight box" says least ambiguously.

use super::{ClusterPoints, Rectangle};

/// The tight rectangle along x and y.
pub fn axis_aligned(points: &ClusterPoints) -> Rectangle {
    points.rectangle(0.0)
}
