//! What a synthetic unknown object may be: shared by the trainer, which bends the points of known objects, and the simulator,
//! which bends their surfaces before they are scanned.
//!
//! Extension of the paper; after the resizing of Koesel et al. (IV 2024) and Cen et al. (ECCV 2022).

/// How a known object is scaled.
pub struct Scaling {
    /// Factors of l, w, h, log-uniform.
    pub factors: [[f64; 2]; 3],
    /// Least l, w, h of what comes of it, m.
    pub least_m: [f64; 3],
}

/// A guess that spans small carts and lorries.
pub const ON_ROADS: Scaling = Scaling {
    factors: [[0.45, 2.4], [0.65, 1.6], [0.7, 2.0]],
    least_m: [0.4, 0.4, 0.8],
};
/// For any sensor: also what is low, as fallen people and dogs are.
pub(crate) const ANYWHERE: Scaling = Scaling {
    factors: [[0.35, 2.4], [0.5, 1.7], [0.3, 2.0]],
    least_m: [0.3, 0.3, 0.3],
};
/// Chance there that the three factors are alike, as of a bus; that the object lies.
pub(crate) const ALIKE_CHANCE: f32 = 0.35;
pub(crate) const LIES_CHANCE: f32 = 0.15;
/// Chance, where trucks are unknown, that a car is stretched to this size, l, w, h, m, log-uniform, from a small van's to a bus's,
pub(crate) const LARGE_CHANCE: f32 = 0.15;
pub(crate) const LARGE_M: [[f32; 2]; 3] = [[4.2, 13.5], [1.75, 2.8], [1.85, 3.9]];
/// and the space above its heights (a share of the whole) is taken to this power: from a car's shape to a box.
pub(crate) const LARGE_BEND: [f32; 2] = [1.0, 3.0];
/// Chance of a join, of a scaled object otherwise.
pub const JOIN_CHANCE: f64 = 0.35;
/// Chance of a cut.
pub const CUT_CHANCE: f64 = 0.35;
/// A cut takes this share of the height,
pub const CUT_SHARE: [f64; 2] = [0.2, 0.45];
/// and starts above this one.
pub const CUT_LOW: f64 = 0.25;

/// Largest l, w, h of anything on a road, m.
const MOST_M: [f64; 3] = [14.0, 3.2, 4.2];
/// All three sizes within this factor of a class' mean: still an object of that class.
const ALIKE_FACTOR: f64 = 1.25;

/// Whether l, w, h are those of something on a road.
pub fn has_road_size(size_m: [f64; 3], scaling: &Scaling) -> bool {
    (0..3).all(|i| (scaling.least_m[i]..=MOST_M[i]).contains(&size_m[i]))
}

/// Whether l, w, h are within those of vans, trucks and buses.
pub(crate) fn is_large(size_m: [f64; 3]) -> bool {
    let within = |i: usize| (LARGE_M[i][0] as f64..=LARGE_M[i][1] as f64).contains(&size_m[i]);
    (0..3).all(within)
}

/// Whether l, w, h are alike those of a known class; `classes_m`: their means.
pub fn has_known_size(size_m: [f64; 3], classes_m: &[[f64; 3]]) -> bool {
    classes_m.iter().any(|class| {
        let factor = |i: usize| (size_m[i] / class[i]).ln().abs();
        (0..3).all(|i| factor(i) < ALIKE_FACTOR.ln())
    })
}
