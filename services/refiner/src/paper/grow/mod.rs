//! How a cluster grows from a seed: one trait, one small file for each algorithm.
//!
//! [`Printed`] and [`Depth`] are the paper's variants. [`Euclidean`] and [`Dbscan`] are known references, for comparisons
//! with other libraries (`bench/peers/clustering`).

mod dbscan;
mod depth;
mod euclidean;
mod printed;

pub use dbscan::Dbscan;
pub use depth::Depth;
pub use euclidean::Euclidean;
pub use printed::Printed;

use crate::paper::neighbourhood::Neighbourhood;

/// Grows the cluster of one candidate.
pub trait Grower: std::fmt::Debug + Send {
    /// Whether the points of the ground must be in the neighbourhood too, as borders between objects.
    fn sees_ground(&self) -> bool {
        false
    }

    /// The points of `around` that belong with the point `seed`, in any order, each once. Empties `members` first. Points
    /// lower than `height_min_m` above the ground are ground.
    fn grow(
        &mut self,
        around: &Neighbourhood,
        seed: usize,
        height_min_m: f64,
        members: &mut Vec<u32>,
    );
}

/// Whether a point stands above the ground.
fn stands(around: &Neighbourhood, height_min_m: f64) -> impl Fn(usize) -> bool + '_ {
    let height_min = height_min_m as f32;
    move |i| around.height_m[i] >= height_min
}

/// Squared distance in space of two points, m^2.
fn distance_squared(around: &Neighbourhood, a: usize, b: usize) -> f32 {
    let dx = around.x_m[a] - around.x_m[b];
    let dy = around.y_m[a] - around.y_m[b];
    let dz = around.z_m[a] - around.z_m[b];
    dx * dx + dy * dy + dz * dz
}
