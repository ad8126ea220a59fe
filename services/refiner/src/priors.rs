//! What is known of road vehicles beforehand, in one table.
//!
//! It completes boxes of what is seen in part, and says which sizes are ranked last. Nothing is left out because of it. The
//! sizes of road users were guessed before any measurement; all others were tuned on simulated validation scans of sim-udi and
//! sim-kitti, which show cars, vans, trucks, golf carts and forklifts (docs/refiner.md).

/// A cluster larger than this (l, w, h, m: a large van) is divided by shorter reaches: two parked cars are longer than one, and as low.
pub(crate) const LOW_M: [f64; 3] = [7.0, 2.8, 4.0];
/// One this high, m, is divided beyond the size of trucks and buses instead.
pub(crate) const TALL_FROM_M: f64 = 2.0;
pub(crate) const TALL_M: [f64; 3] = [14.0, 3.5, 4.5];
/// A cluster longer than this is cut, m: a truck with its trailer is below.
pub(crate) const LENGTH_MAX_M: f64 = 16.0;
/// Within this size (l, w, h, m) a cluster is taken apart only when all its parts stand upright: the mast of a forklift
/// and the rider of a bicycle do, the rest of them does not.
pub(crate) const UPRIGHT_APART_M: [f64; 3] = [3.4, 1.9, 2.6];

/// A side is at least this share of the other one long: away from the sensor it is never seen whole,
pub(crate) const FAR_SIDE_SHARE: f64 = 0.4;
/// but it is not completed beyond this, m: no road user is wider.
pub(crate) const FAR_SIDE_MAX_M: f64 = 2.8;

/// A face that looks like a vehicle's front or rear, seen from the end.
pub(crate) struct EndFace {
    /// Narrowest and widest, m.
    pub(crate) width_m: [f64; 2],
    /// Least height of the box, m.
    pub(crate) height_min_m: f64,
    /// The vehicle is at least this share of its width long.
    pub(crate) share: f64,
}

/// What is seen from the end: cars and vans, then trucks. The first that fits counts.
pub(crate) const ENDS: [EndFace; 2] = [
    EndFace {
        width_m: [1.1, 2.1],
        height_min_m: 1.0,
        share: 2.2,
    },
    EndFace {
        width_m: [2.1, 3.3],
        height_min_m: 2.4,
        share: 3.0,
    },
];
/// Largest angle between the line of sight and an end's length, rad: further round, its side is seen too.
pub(crate) const END_ASIDE_MAX_RAD: f64 = std::f64::consts::FRAC_PI_6;
/// The upper third of an end is at least this share of its width wide: a cyclist seen from the side is narrow above.
pub(crate) const END_TOP_SHARE_MIN: f64 = 0.6;

/// What goes on above the sensor's topmost beam is at least so long, completed away from the sensor, and as it is seen so high, m: a truck, not a car close by.
pub(crate) const CUT_TOP_MIN_M: [f64; 2] = [3.0, 2.0];
/// Its height above the ground is at least this, m.
pub(crate) const CUT_TOP_HEIGHT_M: f64 = 3.2;

/// Sizes (l, w, h: least and most, m) of a road user: a person from one side to a truck.
pub(crate) const ROAD_USER_M: [[f64; 2]; 3] = [[0.4, 14.0], [0.4, 3.2], [0.8, 4.2]];
/// What is higher than the second on a ground shorter than the first is a post, m.
pub(crate) const POST_M: [f64; 2] = [1.2, 2.0];
