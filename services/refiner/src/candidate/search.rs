//! The search for a seed from which a cluster grows that is what was detected.

use mluc_geometry::Box3;

use super::{Candidates, Grown, Scene};
use crate::cluster::Clusterer;
use crate::draft::Draft;
use crate::frame::IndexedPoint;
use crate::neighbourhood::Gather;
use crate::recipe::{Recipe, SeedRule};
use crate::seed::Seek;

/// No other seed is tried where those so far were as dear as a whole scan.
const WORK_PER_SEED_MAX: u64 = 131_072;
/// A cluster with less than one in so many of the points in the proposal's box is not what was detected there: it may be a few
/// returns from within a van, and the van's body lies around them. One in 5 is the same on simulated validation scans, one in 20 a
/// little less (docs/refiner.md).
const SPARSE_ONE_IN: usize = 10;

impl Candidates {
    /// Grows a cluster from seed after seed until one is large enough; of others the largest is taken.
    pub(super) fn search(
        &mut self,
        on: &Scene,
        recipe: &Recipe,
        clusterer: &mut dyn Clusterer,
        draft: &Draft,
    ) -> Grown {
        let (mut grown, mut is_thinned, mut last) = (Grown::default(), false, None);
        let mut largest: Option<(usize, IndexedPoint)> = None;
        for _ in 0..recipe.seeds {
            let Some(seed) = self.next_seed(on, recipe, draft) else {
                break;
            };
            grown = self.grow_from(&seed, on, recipe, clusterer, &draft.shape);
            is_thinned |= grown.is_thinned;
            last = Some(seed.index);
            let found = self.members.len();
            let is_sparse = found * SPARSE_ONE_IN < grown.in_proposal;
            if found >= recipe.points_min && !is_sparse {
                largest = None;
                break;
            }
            if largest.is_none_or(|(most, _)| found > most) {
                largest = Some((found, seed));
            }
            if self.work > WORK_PER_SEED_MAX {
                break;
            }
            let index = |&m: &u32| self.around.index[m as usize];
            self.tried.extend(self.members.iter().map(index));
            self.tried.sort_unstable();
        }
        if let Some((most, seed)) = largest
            && most >= recipe.points_min
            && last != Some(seed.index)
        {
            grown = self.grow_from(&seed, on, recipe, clusterer, &draft.shape);
        }
        Grown {
            is_thinned,
            ..grown
        }
    }

    /// Where to begin, past what was tried.
    fn next_seed(&mut self, on: &Scene, recipe: &Recipe, draft: &Draft) -> Option<IndexedPoint> {
        let seek = Seek {
            frame: on.frame,
            candidate: &draft.shape,
            ground: on.ground,
            height_m: [self.ground.clearance_m, recipe.height_max_m],
            tried: &self.tried,
            is_known: if recipe.keeps_known_apart {
                on.is_known
            } else {
                &[]
            },
        };
        let (key, work) = ((on.sequence, draft.detection as u64), &mut self.work);
        match recipe.seed {
            SeedRule::RandomInside => seek.random_inside(key, &mut self.inside, work),
            SeedRule::NearestToCenter => seek.nearest_to_center(work),
        }
    }

    /// Gathers the points around a seed and grows its cluster among them.
    fn grow_from(
        &mut self,
        seed: &IndexedPoint,
        on: &Scene,
        recipe: &Recipe,
        clusterer: &mut dyn Clusterer,
        proposal: &Box3,
    ) -> Grown {
        let height_min_m = match clusterer.sees_ground() {
            true => f64::NEG_INFINITY,
            false => self.ground.clearance_m,
        };
        let wanted = Gather {
            radius_m: self.radius_m,
            height_m: [height_min_m, recipe.height_max_m],
            points_max: self.points_max,
        };
        let around = &mut self.around;
        let seed = around.gather(on.frame, seed, on.ground, &wanted, on.is_known);
        let tries = recipe.seeds > 1;
        self.work += around.looked_at + if tries { around.len() as u64 } else { 0 };
        let grown = Grown {
            seed_m: [around.x_m[seed], around.y_m[seed]],
            is_thinned: around.thinned,
            // One seed is taken as it comes.
            in_proposal: match tries {
                true => around.count_within(proposal),
                false => 0,
            },
        };
        self.grow(recipe, clusterer, seed);
        grown
    }
}
