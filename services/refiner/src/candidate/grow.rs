//! From a seed to a cluster of a road user's size (paper, algorithm 1, its loop).

use super::Candidates;
use crate::cluster::{Bounds, Clusterer};
use crate::fit::ClusterPoints;
use crate::neighbourhood::Neighbourhood;
use crate::recipe::Recipe;
use crate::size::{is_rest, is_upright, is_within};

/// Work of a point in a growth, in points looked at, measured by time.
const WORK_PER_GROWTH: u64 = 6;

impl Candidates {
    /// Grows the cluster, and again with a shorter reach while it is larger than a road user. Part of it is taken when
    /// that stands upright by itself: people beside each other are joined otherwise.
    ///
    /// A shorter reach gives a part of what a longer one gives, so each growth looks at the last one's points alone.
    pub(super) fn grow(&mut self, recipe: &Recipe, clusterer: &mut dyn Clusterer, mut seed: usize) {
        self.grow_once(recipe, clusterer, seed, 1.0);
        let Some(scales) = &recipe.scales else {
            return;
        };
        if scales.upright > 0.0 && !is_upright(&self.cluster) {
            let is_small = is_within(&self.cluster, scales.upright_apart_m);
            seed = self.around.keep_only(&self.members, seed);
            self.grow_once(recipe, clusterer, seed, scales.upright);
            if self.cluster.len() >= recipe.points_min
                && is_upright(&self.cluster)
                && !(is_small && self.leaves_a_rest(recipe, clusterer))
            {
                return;
            }
            self.take_all();
        }
        let mut scale = 1.0;
        for _ in 0..scales.shrink_attempts {
            if scales.limits.hold(&self.cluster) {
                return;
            }
            scale *= scales.shrink_factor;
            seed = self.around.keep_only(&self.members, seed);
            self.grow_once(recipe, clusterer, seed, scale);
        }
    }

    /// Whether the other parts of the last cluster that do not stand upright are a thing to reckon with. Leaves the
    /// members as they are.
    fn leaves_a_rest(&mut self, recipe: &Recipe, clusterer: &mut dyn Clusterer) -> bool {
        let bounds = self.bounds(recipe, recipe.scales.map_or(1.0, |scales| scales.upright));
        let Candidates {
            around,
            members,
            part,
            cluster,
            is_seen,
            work,
            ..
        } = self;
        is_seen.clear();
        is_seen.resize(around.len(), false);
        members.iter().for_each(|&m| is_seen[m as usize] = true);
        let (mut upright, mut rest) = (members.len(), 0);
        clusterer.grow_rest(around, &bounds, is_seen, part, &mut |part| {
            *work += WORK_PER_GROWTH * around.len() as u64;
            if part.len() >= recipe.points_min {
                collect(around, part, cluster);
                match is_upright(cluster) {
                    true => upright += part.len(),
                    false => rest += part.len(),
                }
            }
        });
        self.collect_cluster();
        is_rest(rest, upright)
    }

    fn take_all(&mut self) {
        self.members.clear();
        self.members.extend(0..self.around.len() as u32);
        self.collect_cluster();
    }

    fn grow_once(
        &mut self,
        recipe: &Recipe,
        clusterer: &mut dyn Clusterer,
        seed: usize,
        scale: f64,
    ) {
        let bounds = self.bounds(recipe, scale);
        clusterer.grow(&self.around, seed, &bounds, &mut self.members);
        self.collect_cluster();
        self.work += WORK_PER_GROWTH * self.around.len() as u64;
    }

    fn bounds(&self, recipe: &Recipe, scale: f64) -> Bounds {
        Bounds {
            height_min_m: match recipe.removes_ground {
                true => self.ground.clearance_m,
                false => f64::NEG_INFINITY,
            },
            scale,
        }
    }

    pub(super) fn collect_cluster(&mut self) {
        collect(&self.around, &self.members, &mut self.cluster);
    }
}

/// The points of `members` by themselves.
fn collect(around: &Neighbourhood, members: &[u32], cluster: &mut ClusterPoints) {
    let columns = [
        (&mut cluster.x_m, &around.x_m),
        (&mut cluster.y_m, &around.y_m),
        (&mut cluster.z_m, &around.z_m),
    ];
    for (to, from) in columns {
        to.clear();
        to.extend(members.iter().map(|&m| from[m as usize]));
    }
    cluster.look_at(around.origin_m);
}
