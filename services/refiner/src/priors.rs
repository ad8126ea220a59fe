//! Prior knowledge of road vehicles, in one table.
//!
//! It completes the boxes of objects that are seen in part, and decides which sizes are ranked last. No object is left out
//! because of it. The sizes of road users were guessed before any measurement; all other numbers were tuned on simulated
//! validation scans of sim-udi and sim-kitti, which show cars, vans, trucks, golf carts and forklifts (docs/refiner.md).

/// A cluster larger than this (l, w, h, m: a large van) is divided by shorter join distances: two parked cars are longer than one, and as low.
pub(crate) const LOW_M: [f64; 3] = [7.0, 2.8, 4.0];
/// A cluster at least this high, m, is instead divided if it is larger than trucks and buses.
pub(crate) const TALL_FROM_M: f64 = 2.0;
pub(crate) const TALL_M: [f64; 3] = [14.0, 3.5, 4.5];
/// A cluster longer than this is cut, m: a truck with its trailer is shorter.
pub(crate) const LENGTH_MAX_M: f64 = 16.0;
/// A cluster within this size (l, w, h, m) is only divided when all its parts stand upright: a forklift's mast and a
/// bicycle's rider do, the rest of the vehicle does not.
pub(crate) const UPRIGHT_APART_M: [f64; 3] = [3.4, 1.9, 2.6];
/// A side is completed to at least this share of the other side: the side away from the sensor is never seen whole.
pub(crate) const FAR_SIDE_SHARE: f64 = 0.4;
/// A side is not completed beyond this, m: no road user is wider.
pub(crate) const FAR_SIDE_MAX_M: f64 = 2.8;

/// A face that looks like a vehicle's front or rear, seen from the end.
pub(crate) struct EndFace {
    /// Minimum and maximum width, m.
    pub(crate) width_m: [f64; 2],
    /// Minimum height of the box, m.
    pub(crate) height_min_m: f64,
    /// Minimum length of the vehicle, as a multiple of its width.
    pub(crate) share: f64,
}

/// Vehicles seen from the end: cars and vans, then trucks. The first that fits counts.
pub(crate) const ENDS: [EndFace; 2] = [
    EndFace { width_m: [1.1, 2.1], height_min_m: 1.0, share: 2.2 },
    EndFace { width_m: [2.1, 3.3], height_min_m: 2.4, share: 3.0 },
];
/// Maximum angle between the line of sight and the vehicle's length, rad: at larger angles its side is seen too.
pub(crate) const END_ASIDE_MAX_RAD: f64 = std::f64::consts::FRAC_PI_6;
/// Minimum width of an end's upper third, as a share of the end's width: a cyclist seen from the side is narrow above.
pub(crate) const END_TOP_SHARE_MIN: f64 = 0.6;
/// Minimum completed length and seen height, m, of an object that continues above the sensor's topmost beam: a truck, not a car close by.
pub(crate) const CUT_TOP_MIN_M: [f64; 2] = [3.0, 2.0];
/// Minimum height of such an object above the ground, m.
pub(crate) const CUT_TOP_HEIGHT_M: f64 = 3.2;
/// Sizes (l, w, h: minimum and maximum, m) of a road user: from a person seen from one side to a truck.
pub(crate) const ROAD_USER_M: [[f64; 2]; 3] = [[0.4, 14.0], [0.4, 3.2], [0.8, 4.2]];
/// An object with both sides shorter than the first number and higher than the second is a post, m.
pub(crate) const POST_M: [f64; 2] = [1.2, 2.0];
