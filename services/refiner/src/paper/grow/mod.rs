//! How a cluster grows from a seed: one trait, one small file for each algorithm.
//!
//! [`Printed`] is the paper's algorithm, [`Depth`] the corrected one.

mod depth;
mod printed;

pub use depth::Depth;
pub use printed::Printed;

use crate::{paper::buckets::Buckets, paper::neighbourhood::Neighbourhood};

/// The input from which a cluster grows.
#[derive(Clone, Copy, Debug)]
pub struct Growth<'a> {
    /// All points that may join.
    pub around: &'a Neighbourhood,
    /// The point from which it grows.
    pub seed: usize,
    /// Points lower than this above the ground are ground, m.
    pub height_min_m: f64,
}

/// Grows the cluster of one candidate.
pub trait Grower: std::fmt::Debug + Send {
    /// Sets `members` to the points that belong with the seed, in any order, each once.
    fn grow(&mut self, growth: &Growth, members: &mut Vec<u32>);
}

impl Growth<'_> {
    /// Whether a point stands above the ground.
    fn stands(&self, point: usize) -> bool {
        self.around.height_m[point] >= self.height_min_m as f32
    }

    fn place_m(&self, point: usize) -> [f32; 2] {
        [self.around.x_m[point], self.around.y_m[point]]
    }

    fn distance_squared(&self, a: usize, b: usize) -> f32 {
        let dx = self.around.x_m[a] - self.around.x_m[b];
        let dy = self.around.y_m[a] - self.around.y_m[b];
        let dz = self.around.z_m[a] - self.around.z_m[b];
        dx * dx + dy * dy + dz * dz
    }

    /// Region growing: each member tests the points within its own reach (at most `reach_max_m`, m) that no member has
    /// tested before; `joins` decides which of them join.
    fn over_neighbours(
        &self,
        buckets: &mut Buckets,
        reach_max_m: f32,
        reach_m: impl Fn(usize) -> f32,
        joins: impl Fn(usize, usize) -> bool,
        members: &mut Vec<u32>,
    ) {
        let stands = |i| i != self.seed && self.stands(i);
        buckets.fill(self.around, reach_max_m, stands);
        members.clear();
        members.push(self.seed as u32);
        let mut next = 0;
        while let Some(&t) = members.get(next) {
            next += 1;
            let t = t as usize;
            let reach_m = reach_m(t).min(reach_max_m);
            buckets.take_around(self.place_m(t), |s| {
                let is_near = self.distance_squared(s as usize, t) <= reach_m * reach_m;
                if is_near && joins(s as usize, t) {
                    members.push(s);
                }
                is_near
            });
        }
    }
}
