//! Euclidean clusters: points above the ground closer than one tolerance belong together. A known reference.

use super::{Grower, distance_squared, stands};
use crate::paper::buckets::ShrinkingBuckets;
use crate::paper::neighbourhood::Neighbourhood;

/// Region growing with a fixed distance in space.
#[derive(Debug)]
pub struct Euclidean {
    tolerance_m: f32,
    buckets: ShrinkingBuckets,
}

impl Euclidean {
    /// Points closer than this are joined, m.
    pub fn new(tolerance_m: f32) -> Euclidean {
        Euclidean {
            tolerance_m,
            buckets: ShrinkingBuckets::default(),
        }
    }
}

impl Grower for Euclidean {
    fn grow(
        &mut self,
        around: &Neighbourhood,
        seed: usize,
        height_min_m: f64,
        members: &mut Vec<u32>,
    ) {
        let tolerance_m = self.tolerance_m;
        grow_within(
            &mut self.buckets,
            around,
            seed,
            height_min_m,
            |_| tolerance_m,
            tolerance_m,
            members,
        );
    }
}

/// Region growing where each point reaches as far as `reach_m` says, at most `reach_max_m`.
pub(super) fn grow_within(
    buckets: &mut ShrinkingBuckets,
    around: &Neighbourhood,
    seed: usize,
    height_min_m: f64,
    reach_m: impl Fn(usize) -> f32,
    reach_max_m: f32,
    members: &mut Vec<u32>,
) {
    let allowed = stands(around, height_min_m);
    buckets.fill(&around.x_m, &around.y_m, reach_max_m, |i| {
        i != seed && allowed(i)
    });
    members.clear();
    members.push(seed as u32);
    let mut next = 0;
    while let Some(&t) = members.get(next) {
        next += 1;
        let t = t as usize;
        let reach = reach_m(t).min(reach_max_m);
        let cell = buckets.grid.cell_at(around.x_m[t], around.y_m[t]);
        for dy in -1..=1 {
            for dx in -1..=1 {
                let Some(cell) = buckets.grid.shifted(cell, dx, dy) else {
                    continue;
                };
                buckets.take(cell, |s| {
                    let joined = distance_squared(around, s as usize, t) <= reach * reach;
                    if joined {
                        members.push(s);
                    }
                    joined
                });
            }
        }
    }
}
