//! DBSCAN (Ester, Kriegel, Sander and Xu, 1996), grown from the seed alone: a known reference.
//!
//! A core point has enough points within epsilon; a cluster is what core points reach. A seed that is no core point
//! grows nothing but itself.

use super::{Grower, distance_squared, stands};
use crate::paper::buckets::Buckets;
use crate::paper::neighbourhood::Neighbourhood;

/// Density-based clusters with a fixed radius in space.
#[derive(Debug)]
pub struct Dbscan {
    epsilon_m: f32,
    core_points: usize,
    buckets: Buckets,
    is_member: Vec<bool>,
}

impl Dbscan {
    /// With the radius of a neighbourhood, m, and the points within it, itself included, that make a core point.
    pub fn new(epsilon_m: f32, core_points: usize) -> Dbscan {
        Dbscan {
            epsilon_m,
            core_points,
            buckets: Buckets::default(),
            is_member: Vec::new(),
        }
    }
}

impl Grower for Dbscan {
    fn grow(
        &mut self,
        around: &Neighbourhood,
        seed: usize,
        height_min_m: f64,
        members: &mut Vec<u32>,
    ) {
        let epsilon_m = self.epsilon_m;
        let allowed = stands(around, height_min_m);
        self.buckets.fill(&around.x_m, &around.y_m, epsilon_m, |i| {
            i == seed || allowed(i)
        });
        self.is_member.clear();
        self.is_member.resize(around.len(), false);
        let near =
            |a: usize, b: u32| distance_squared(around, a, b as usize) <= epsilon_m * epsilon_m;
        members.clear();
        members.push(seed as u32);
        self.is_member[seed] = true;
        let mut next = 0;
        while let Some(&t) = members.get(next) {
            next += 1;
            let t = t as usize;
            let cell = self.buckets.cell_at(around.x_m[t], around.y_m[t]);
            let block = || {
                self.buckets
                    .block(cell)
                    .flat_map(|c| self.buckets.points(c))
            };
            let reached = block()
                .filter(|&&s| near(t, s))
                .take(self.core_points)
                .count();
            if reached < self.core_points {
                continue;
            }
            for &s in block() {
                if !self.is_member[s as usize] && near(t, s) {
                    self.is_member[s as usize] = true;
                    members.push(s);
                }
            }
        }
    }
}
