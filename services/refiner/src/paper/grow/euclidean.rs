//! Euclidean clusters: points above the ground closer than one tolerance belong together. A known reference.

use super::{Grower, Growth};
use crate::paper::buckets::Buckets;

/// Region growing with a fixed distance in space.
#[derive(Debug)]
pub struct Euclidean {
    tolerance_m: f32,
    buckets: Buckets,
}

impl Euclidean {
    /// Points closer than this are joined, m.
    pub fn new(tolerance_m: f32) -> Euclidean {
        Euclidean {
            tolerance_m,
            buckets: Buckets::default(),
        }
    }
}

impl Grower for Euclidean {
    fn grow(&mut self, growth: &Growth, members: &mut Vec<u32>) {
        let (most_m, buckets) = (self.tolerance_m, &mut self.buckets);
        growth.over_neighbours(buckets, most_m, |_| most_m, |_, _| true, members);
    }
}
