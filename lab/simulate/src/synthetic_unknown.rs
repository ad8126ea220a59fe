//! Limits and chances of synthetic unknown objects. The trainer uses them to change points of known objects, the simulator
//! to change surfaces of known objects before the scan.
//!
//! Extension of the paper; after the resizing of Koesel et al. (IV 2024) and Cen et al. (ECCV 2022).

/// Range of scaling for a known object.
pub struct Scaling {
    /// Factors of l, w, h, log-uniform.
    pub factors: [[f64; 2]; 3],
    /// Minimum l, w, h of the result, m.
    pub least_m: [f64; 3],
}

/// A guess that covers small carts to lorries.
pub const ON_ROADS: Scaling =
    Scaling { factors: [[0.45, 2.4], [0.65, 1.6], [0.7, 2.0]], least_m: [0.4, 0.4, 0.8] };
/// For any sensor: also low objects, such as fallen people and dogs.
pub(crate) const ANYWHERE: Scaling =
    Scaling { factors: [[0.35, 2.4], [0.5, 1.7], [0.3, 2.0]], least_m: [0.3, 0.3, 0.3] };
/// Chances in `sim-any`: that the three factors are alike, as for a bus; that the object is laid down.
pub(crate) const ALIKE_CHANCE: f32 = 0.35;
pub(crate) const LIES_CHANCE: f32 = 0.15;
/// Where trucks are unknown: chance that a car is enlarged, and its new l, w, h, m, log-uniform, from a small van to a bus.
pub(crate) const LARGE_CHANCE: f32 = 0.15;
pub(crate) const LARGE_M: [[f32; 2]; 3] = [[4.2, 13.5], [1.75, 2.8], [1.85, 3.9]];
/// Exponent range for the space above its heights (a share of the whole), from a car's shape to a box.
pub(crate) const LARGE_BEND: [f32; 2] = [1.0, 3.0];
/// Chance of a join; otherwise the object is only scaled.
pub const JOIN_CHANCE: f64 = 0.35;
/// Chance of a cut.
pub const CUT_CHANCE: f64 = 0.35;
/// Share of the height that a cut removes.
pub const CUT_SHARE: [f64; 2] = [0.2, 0.45];
/// Share of the height below which a cut does not start.
pub const CUT_LOW: f64 = 0.25;
/// Maximum l, w, h of an object on a road, m.
const MOST_M: [f64; 3] = [14.0, 3.2, 4.2];
/// With all three sizes within this factor of a class' mean the object still counts as that class.
const ALIKE_FACTOR: f64 = 1.25;

/// Whether l, w, h fit an object on a road.
pub fn has_road_size(size_m: [f64; 3], scaling: &Scaling) -> bool {
    (0..3).all(|i| (scaling.least_m[i]..=MOST_M[i]).contains(&size_m[i]))
}

/// Whether l, w, h are within the range of vans, trucks and buses.
pub(crate) fn is_large(size_m: [f64; 3]) -> bool {
    let within = |i: usize| (LARGE_M[i][0] as f64..=LARGE_M[i][1] as f64).contains(&size_m[i]);
    (0..3).all(within)
}

/// Whether l, w, h are close to a known class; `classes_m`: mean sizes of the classes.
pub fn has_known_size(size_m: [f64; 3], classes_m: &[[f64; 3]]) -> bool {
    classes_m.iter().any(|class| {
        let factor = |i: usize| (size_m[i] / class[i]).ln().abs();
        (0..3).all(|i| factor(i) < ALIKE_FACTOR.ln())
    })
}
