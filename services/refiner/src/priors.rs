//! What is known of road vehicles beforehand: data with their source, in one table.
//!
//! They complete boxes of what is seen in part, and say which sizes are ranked last. Nothing is left out because of them.

use crate::size::SizeLimits;

/// A large thing that goes on above the sensor's topmost beam.
#[derive(Clone, Copy, Debug)]
pub struct CutTop {
    /// Only what is at least so long, m, and
    pub length_min_m: f64,
    /// at least so high as it is seen, m: a truck, not a car close by.
    pub seen_min_m: f64,
    /// Its height above the ground is at least this, m.
    pub height_m: f64,
}

/// A face that looks like a vehicle's front or rear, seen from the end.
#[derive(Clone, Copy, Debug)]
pub struct EndFace {
    /// Narrowest and widest, m.
    pub width_m: [f64; 2],
    /// Least height of the box, m.
    pub height_min_m: f64,
    /// The vehicle is at least this share of its width long.
    pub share: f64,
}

/// A set of priors.
#[derive(Clone, Copy, Debug)]
pub struct Priors {
    /// What they are of.
    pub name: &'static str,
    /// Where the numbers come from.
    pub source: &'static str,
    /// A cluster larger than this (a large van) is divided by shorter reaches, unless it is as high as a truck.
    pub whole: SizeLimits,
    /// A cluster longer than this is cut, m: a truck with its trailer is below.
    pub length_max_m: f64,
    /// Within this size (l, w, h, m) a cluster is taken apart only when all its parts stand upright: the mast of a forklift
    /// and the rider of a bicycle do, the rest of them does not.
    pub upright_apart_m: [f64; 3],
    /// A side is at least this share of the other one long: away from the sensor it is never seen whole,
    pub far_side_share: f64,
    /// but it is not completed beyond this, m: no road user is wider.
    pub far_side_max_m: f64,
    /// What is seen from the end: cars and vans, then trucks. The first that fits counts.
    pub ends: [EndFace; 2],
    /// Largest angle between the line of sight and an end's length, rad: further round, its side is seen too.
    pub end_aside_max_rad: f64,
    /// The upper third of an end is at least this share of its width wide: a cyclist seen from the side is narrow above.
    pub end_top_share_min: f64,
    /// What the sensor does not see the top of.
    pub cut_top: CutTop,
    /// Sizes (l, w, h: least and most, m) of a road user: a person from one side to a truck.
    pub road_user_m: [[f64; 2]; 3],
    /// What is higher than the second on a ground shorter than the first is a post, m.
    pub post_m: [f64; 2],
}

/// Those in use.
pub static PRIORS: Priors = Priors {
    name: "road vehicles",
    source: "sizes of road users: guessed before any measurement; all others: tuned on simulated validation scans of sim-udi and sim-kitti, which show cars, vans, trucks, golf carts and forklifts (docs/refiner.md)",
    whole: SizeLimits {
        low_m: [7.0, 2.8, 4.0],
        tall_from_m: 2.0,
        tall_m: [14.0, 3.5, 4.5],
    },
    length_max_m: 16.0,
    upright_apart_m: [3.4, 1.9, 2.6],
    far_side_share: 0.4,
    far_side_max_m: 2.8,
    ends: [
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
    ],
    end_aside_max_rad: std::f64::consts::FRAC_PI_6,
    end_top_share_min: 0.6,
    cut_top: CutTop {
        length_min_m: 3.0,
        seen_min_m: 2.0,
        height_m: 3.2,
    },
    road_user_m: [[0.4, 14.0], [0.4, 3.2], [0.8, 4.2]],
    post_m: [1.2, 2.0],
};
