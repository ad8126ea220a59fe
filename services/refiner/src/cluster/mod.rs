//! How a cluster grows from a seed: one trait, one small file for each algorithm.

mod dbscan;
mod depth;
mod distance;
mod euclidean;
mod literal;

pub use dbscan::Dbscan;
pub use depth::Depth;
pub use distance::Distance;
pub use euclidean::Euclidean;
pub use literal::Literal;

use crate::neighbourhood::Neighbourhood;

/// Bounds of one growth, beside the cylinder that the neighbourhood is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Points below this height above the ground are ground, m; minus infinity where there is none to remove.
    pub height_min_m: f64,
    /// 1, and smaller when the last growth came out larger than a road user: scales the reach of a join.
    pub scale: f64,
}

/// Grows the cluster of one candidate.
pub trait Clusterer: std::fmt::Debug + Send {
    /// Whether the points of the ground must be in the neighbourhood too, as borders between objects.
    fn sees_ground(&self) -> bool {
        false
    }

    /// The points of `around` that belong with the point `seed`, in any order, each once. Empties `members` first.
    fn grow(
        &mut self,
        around: &Neighbourhood,
        seed: usize,
        bounds: &Bounds,
        members: &mut Vec<u32>,
    );

    /// Of points that were grown as one cluster: grows a part from every point that is in none before, in the points'
    /// order, and hands each to `take`. `is_taken` says which points are in one, and is kept up to date; `members` is a
    /// buffer.
    fn grow_rest(
        &mut self,
        around: &Neighbourhood,
        bounds: &Bounds,
        is_taken: &mut [bool],
        members: &mut Vec<u32>,
        take: &mut dyn FnMut(&[u32]),
    ) {
        for seed in 0..around.len() {
            if !is_taken[seed] {
                self.grow(around, seed, bounds, members);
                is_taken[seed] = true;
                members.iter().for_each(|&m| is_taken[m as usize] = true);
                take(members);
            }
        }
    }
}

/// Whether a point may belong to the seed's cluster: it stands above the ground, and either both or neither of them are
/// owned by a known object. So an obstacle that touches a known truck stays a cluster of its own.
fn is_allowed<'a>(
    around: &'a Neighbourhood,
    seed: usize,
    bounds: &Bounds,
) -> impl Fn(usize) -> bool + 'a {
    let height_min = bounds.height_min_m as f32;
    let is_known = around.is_known[seed];
    move |i| around.height_m[i] >= height_min && around.is_known[i] == is_known
}

/// Squared distance in space of two points, m^2.
fn distance_squared(around: &Neighbourhood, a: usize, b: usize) -> f32 {
    let dx = around.x_m[a] - around.x_m[b];
    let dy = around.y_m[a] - around.y_m[b];
    let dz = around.z_m[a] - around.z_m[b];
    dx * dx + dy * dy + dz * dz
}
