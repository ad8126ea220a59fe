//! Algorithm 1 as the paper prints it.
//!
//! Neighbours are points closer than a fixed distance in space. A neighbour joins when the angle is *below* 65 degrees; a
//! refused one is never tested again. On a face seen frontally the angle is near 90 degrees, and across a jump in depth near
//! 0. So the printed sign splits surfaces and joins points behind them: see [`super::Depth`].

use super::{Grower, Growth};
use crate::{paper::angle::is_above, paper::buckets::Buckets};

/// Neighbours N(t): points closer than this in space, m. The paper does not give the distance.
const NEIGHBOUR_M: f32 = 0.5;
/// lambda_theta, degrees: points are joined when the angle is below this (paper).
const ANGLE_MAX_DEG: f64 = 65.0;

/// Algorithm 1 exactly as printed.
#[derive(Debug, Default)]
pub struct Printed {
    buckets: Buckets,
}

impl Grower for Printed {
    /// `members` is the queue Q, read from its front; at the end it is R. The printed set of seen points is the points removed from the buckets.
    fn grow(&mut self, growth: &Growth, members: &mut Vec<u32>) {
        let angle_max_cosine = ANGLE_MAX_DEG.to_radians().cos() as f32;
        let point = |i: usize| growth.around.in_sensor_m(i).map(|v| v as f32);
        let joins = |s: usize, t: usize| !is_above(point(s), point(t), angle_max_cosine);
        let buckets = &mut self.buckets;
        growth.over_neighbours(buckets, NEIGHBOUR_M, |_| NEIGHBOUR_M, joins, members);
    }
}
