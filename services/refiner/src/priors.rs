//! What is known of road vehicles beforehand: data with their source, in one table.
//!
//! They complete boxes of what is seen in part, and say which sizes are ranked last. Nothing is left out because of them.

use crate::fit::{CutTop, EndFace, Extend, Side};
use crate::size::SizeLimits;
use crate::{Sensor, Settings};

/// A set of priors.
#[derive(Debug)]
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
    /// The side away from the sensor: never seen whole.
    pub far_side: Side,
    /// What is seen from the end: cars and vans, then trucks.
    pub ends: [EndFace; 2],
    /// Height above the ground of what goes on above the topmost beams, m, from this length and seen height on, m.
    pub cut_top: CutTop,
    /// Sizes (l, w, h: least and most, m) of a road user: a person from one side to a truck.
    pub road_user_m: [[f64; 2]; 3],
    /// What is higher than the second on a ground shorter than the first is a post, m.
    pub post_m: [f64; 2],
}

/// 30 degrees.
const ASIDE_MAX_RAD: f64 = std::f64::consts::FRAC_PI_6;

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
    far_side: Side {
        least_m: 0.0,
        share: 0.4,
        most_m: 2.8,
    },
    ends: [
        EndFace {
            width_m: [1.1, 2.1],
            height_min_m: 1.0,
            aside_max_rad: ASIDE_MAX_RAD,
            share: 2.2,
            top_share_min: 0.6,
        },
        EndFace {
            width_m: [2.1, 3.3],
            height_min_m: 2.4,
            aside_max_rad: ASIDE_MAX_RAD,
            share: 3.0,
            top_share_min: 0.6,
        },
    ],
    cut_top: CutTop {
        elevation_rad: 0.0,
        length_min_m: 3.0,
        seen_min_m: 2.0,
        height_m: 3.2,
    },
    road_user_m: [[0.4, 14.0], [0.4, 3.2], [0.8, 4.2]],
    post_m: [1.2, 2.0],
};

/// Sizes of published boxes are above 0.
const SIZE_MIN_M: [f64; 3] = [0.1; 3];

/// How a variant makes a box of a tight rectangle.
pub(crate) fn extend_of(settings: &Settings, sensor: &Sensor) -> Extend {
    use crate::Variant::{Paper, RangeScaled};
    let tight = Extend {
        to_ground: settings.variant != Paper,
        away_from_sensor: None,
        end_faces: [None; 2],
        cut_top: None,
        size_min_m: SIZE_MIN_M,
    };
    if settings.variant != RangeScaled {
        return tight;
    }
    /// Returns of the topmost two beams or so, rad: beams of one sensor differ from the table by about 0.1 degrees.
    const MARGIN_RAD: f64 = 0.009;
    let beams = sensor.beams.as_ref();
    let top_rad = beams.and_then(|beams| beams.elevation_rad.first());
    Extend {
        away_from_sensor: Some(PRIORS.far_side),
        end_faces: PRIORS.ends.map(Some),
        cut_top: top_rad.map(|top| CutTop {
            elevation_rad: f64::from(*top) - MARGIN_RAD,
            ..PRIORS.cut_top
        }),
        ..tight
    }
}
