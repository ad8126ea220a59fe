//! Algorithm 1 as the paper prints it.
//!
//! Neighbours are points closer than a fixed distance in space; a neighbour joins when the angle is *below* 65 degrees;
//! one that is refused is never looked at again. On a face seen frontally the angle is near 90 degrees and across a jump
//! in depth near 0, so the printed sign splits surfaces and joins what lies behind them: see [`super::Depth`].

use super::{Bounds, Clusterer, is_allowed};
use crate::angle::is_above;
use crate::buckets::ShrinkingBuckets;
use crate::neighbourhood::Neighbourhood;
use crate::settings::LiteralSettings;

/// Algorithm 1 to the letter.
#[derive(Debug)]
pub struct Literal {
    neighbour_m: f32,
    angle_max_cosine: f32,
    buckets: ShrinkingBuckets,
}

impl Literal {
    /// From the settings.
    pub fn new(settings: &LiteralSettings) -> Literal {
        Literal {
            neighbour_m: settings.neighbour_m as f32,
            angle_max_cosine: settings.angle_max_deg.to_radians().cos() as f32,
            buckets: ShrinkingBuckets::default(),
        }
    }
}

impl Clusterer for Literal {
    fn sees_ground(&self) -> bool {
        true
    }

    /// `members` is the queue Q, read from its front, and ends as R. The printed set of points seen is what the buckets
    /// no longer hold.
    fn grow(
        &mut self,
        around: &Neighbourhood,
        seed: usize,
        bounds: &Bounds,
        members: &mut Vec<u32>,
    ) {
        let allowed = is_allowed(around, seed, bounds);
        self.buckets
            .fill(&around.x_m, &around.y_m, self.neighbour_m, |i| {
                i != seed && allowed(i)
            });
        let point = |i: usize| around.in_sensor_m(i).map(|v| v as f32);
        let neighbour_squared = self.neighbour_m * self.neighbour_m;
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
