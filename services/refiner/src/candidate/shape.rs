//! From a cluster to its box, outline and fate.

use mluc_geometry::Box3;
use mluc_ipc_types::{Fate, Object};

use super::Candidates;
use crate::draft::Draft;
use crate::fit::{Rectangle, footprint};
use crate::ground::GroundPlane;
use crate::recipe::Recipe;
use crate::size::longest_side;

/// Work of a point in the box and its outline, in points looked at, measured by time.
const WORK_PER_SHAPE: u64 = 12;

impl Candidates {
    /// Box, outline and fate from the cluster.
    pub(super) fn shape(
        &mut self,
        recipe: &Recipe,
        ground: &GroundPlane,
        seed_m: [f32; 2],
        draft: &mut Draft,
    ) {
        if self.cluster.len() < recipe.points_min.max(1) {
            draft.fate = Fate::TooFewPoints;
            return;
        }
        self.work += WORK_PER_SHAPE * self.cluster.len() as u64;
        let (mut rectangle, mut fitted) = self.fit(recipe, ground);
        if fitted.size_m[0] > self.length_max_m {
            let whole = self.cluster.len();
            self.keep_piece_around(seed_m);
            if self.cluster.len() < whole {
                (rectangle, fitted) = self.fit(recipe, ground);
                draft.flags |= Object::SPLIT;
            }
        }
        draft.shape = fitted;
        let (corners, count) = footprint(&self.cluster, &rectangle);
        draft.set_footprint(&corners[..count], self.around.origin_m);
    }

    fn fit(&mut self, recipe: &Recipe, ground: &GroundPlane) -> (Rectangle, Box3) {
        let rectangle = self.fitter.fit(recipe.fit, &self.cluster);
        let origin_m = self.around.origin_m;
        let extend = &recipe.extend;
        let fitted = extend.box_around(&self.cluster, &rectangle, origin_m, ground);
        // Only a cluster without points has no box, and such are told before.
        (rectangle, fitted.unwrap_or_else(|| Box3::new([0.0; 7])))
    }

    /// Of a cluster longer than any road user the piece around the seed: it is cut across its longest side into equal
    /// pieces of at most that length. What is cut off is no object of this candidate; it is there for others.
    fn keep_piece_around(&mut self, seed_m: [f32; 2]) {
        let (yaw_rad, length_m) = longest_side(&self.cluster);
        let along = [yaw_rad.cos() as f32, yaw_rad.sin() as f32];
        let [low, _] = self.cluster.span_m(along);
        let count = (length_m / self.length_max_m).ceil().max(1.0) as f32;
        let piece_m = length_m as f32 / count;
        let piece = |x: f32, y: f32| {
            let at = (x * along[0] + y * along[1] - low) / piece_m;
            (at as i32).clamp(0, count as i32 - 1)
        };
        let own = piece(seed_m[0], seed_m[1]);
        let around = &self.around;
        self.members
            .retain(|&m| piece(around.x_m[m as usize], around.y_m[m as usize]) == own);
        self.collect_cluster();
    }
}
