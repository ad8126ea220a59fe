//! DBSCAN (Ester, Kriegel, Sander and Xu, 1996), grown from the seed alone: a known reference.
//!
//! A core point has enough points within epsilon; a cluster is what core points reach. A seed that is no core point
//! grows nothing but itself.

use super::{Grower, Growth};
use crate::paper::buckets::Buckets;

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
    fn grow(&mut self, growth: &Growth, members: &mut Vec<u32>) {
        let epsilon_m = self.epsilon_m;
        self.buckets.fill(growth.around, epsilon_m, |i| {
            i == growth.seed || growth.stands(i)
        });
        self.is_member.clear();
        self.is_member.resize(growth.around.len(), false);
        members.clear();
        members.push(growth.seed as u32);
        self.is_member[growth.seed] = true;
        let mut next = 0;
        while let Some(&t) = members.get(next) {
            next += 1;
            let t = t as usize;
            let near = || {
                let block = self.buckets.around(growth.place_m(t));
                let near = move |s: usize| growth.distance_squared(t, s) <= epsilon_m * epsilon_m;
                block.filter(move |&s| near(s as usize))
            };
            if near().take(self.core_points).count() < self.core_points {
                continue;
            }
            for s in near() {
                if !std::mem::replace(&mut self.is_member[s as usize], true) {
                    members.push(s);
                }
            }
        }
    }
}
