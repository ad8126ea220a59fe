//! Algorithm 1 as the paper prints it.
//!
//! Neighbours are points closer than a fixed distance in space; a neighbour joins when the angle is *below* 65 degrees;
//! one that is refused is never looked at again. On a face seen frontally the angle is near 90 degrees and across a jump
//! in depth near 0, so the printed sign splits surfaces and joins what lies behind them: see [`super::Depth`].

use super::{Grower, stands};
use crate::paper::angle::is_above;
use crate::paper::buckets::ShrinkingBuckets;
use crate::paper::neighbourhood::Neighbourhood;

/// Neighbours N(t): points closer than this in space, m. The paper leaves it open.
const NEIGHBOUR_M: f32 = 0.5;
/// lambda_theta, degrees: joined when the angle is below (paper).
const ANGLE_MAX_DEG: f64 = 65.0;

/// Algorithm 1 to the letter.
#[derive(Debug)]
pub struct Printed {
    angle_max_cosine: f32,
    buckets: ShrinkingBuckets,
}

impl Default for Printed {
    fn default() -> Printed {
        Printed {
            angle_max_cosine: ANGLE_MAX_DEG.to_radians().cos() as f32,
            buckets: ShrinkingBuckets::default(),
        }
    }
}

impl Grower for Printed {
    fn sees_ground(&self) -> bool {
        true
    }

    /// `members` is the queue Q, read from its front, and ends as R. The printed set of points seen is what the buckets
    /// no longer hold.
    fn grow(
        &mut self,
        around: &Neighbourhood,
        seed: usize,
        height_min_m: f64,
        members: &mut Vec<u32>,
    ) {
        let allowed = stands(around, height_min_m);
        self.buckets
            .fill(&around.x_m, &around.y_m, NEIGHBOUR_M, |i| {
                i != seed && allowed(i)
            });
        let point = |i: usize| around.in_sensor_m(i).map(|v| v as f32);
        let neighbour_squared = NEIGHBOUR_M * NEIGHBOUR_M;
        members.clear();
        members.push(seed as u32);
        let mut next = 0;
        while let Some(&t) = members.get(next) {
            next += 1;
            let t = t as usize;
            // Every allowed point has a cell; the seed's is that of its coordinates.
            let cell = self.buckets.grid.cell_at(around.x_m[t], around.y_m[t]);
            for dy in -1..=1 {
                for dx in -1..=1 {
                    let Some(cell) = self.buckets.grid.shifted(cell, dx, dy) else {
                        continue;
                    };
                    self.buckets.take(cell, |s| {
                        let near =
                            super::distance_squared(around, s as usize, t) <= neighbour_squared;
                        if near && !is_above(point(s as usize), point(t), self.angle_max_cosine) {
                            members.push(s);
                        }
                        near
                    });
                }
            }
        }
    }
}
