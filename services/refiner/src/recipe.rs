//! What a mode consists of: the parts that are put together for it.

use crate::cluster::{Clusterer, Dbscan, Depth, Distance, Euclidean, Literal};
use crate::draft::Ranking;
use crate::fit::{BoxFit, CutTop, EndFace, Extend, Side};
use crate::size::SizeLimits;
use crate::{DistanceSettings, Mode, Sensor, Settings};

/// Which point a cluster starts from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SeedRule {
    /// A random one inside the box (the paper).
    RandomInside,
    /// The one nearest the centre that stands on the ground.
    NearestToCenter,
}

/// Who suppresses whom.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MergeRule {
    /// Larger boxes first, by rotated overlap; known objects play no part (the paper).
    LargerFirst,
    /// Better scores first, by intersection over the smaller area; known objects suppress.
    BetterFirst,
    /// Nobody: the proposals stay as they are.
    KnownOnly,
}

/// The parts of a mode.
#[derive(Debug)]
pub(crate) struct Recipe {
    pub(crate) seed: SeedRule,
    /// Seeds tried while clusters come out too small.
    pub(crate) seeds: usize,
    pub(crate) merge: MergeRule,
    /// Whether the ground is looked for and removed.
    pub(crate) removes_ground: bool,
    /// Points higher above the ground belong to nothing on the road, m.
    pub(crate) height_max_m: f64,
    pub(crate) fit: BoxFit,
    pub(crate) extend: Extend,
    /// Reaches tried one after the other; `None`: one.
    pub(crate) scales: Option<Scales>,
    /// Whether the points of known objects are kept apart.
    pub(crate) keeps_known_apart: bool,
    pub(crate) points_min: usize,
    pub(crate) ranking: Ranking,
}

/// Reaches tried one after the other, as factors on the full one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Scales {
    /// For what stands upright; 0: not tried.
    pub(crate) upright: f64,
    /// A cluster within this, l, w, h, m, is parted only when all its parts stand upright.
    pub(crate) upright_apart_m: [f64; 3],
    /// Sizes above which a cluster is grown again with a shorter reach.
    pub(crate) limits: SizeLimits,
    pub(crate) shrink_factor: f64,
    pub(crate) shrink_attempts: u32,
}

impl Scales {
    /// One reach for everything.
    pub(crate) const NONE: Scales = Scales {
        upright: 0.0,
        upright_apart_m: [0.0; 3],
        limits: SizeLimits {
            low_m: [f64::INFINITY; 3],
            tall_from_m: f64::INFINITY,
            tall_m: [f64::INFINITY; 3],
        },
        shrink_factor: 1.0,
        shrink_attempts: 0,
    };
}

/// Sizes of published boxes are above 0.
const SIZE_MIN_M: [f64; 3] = [0.1; 3];

impl Recipe {
    pub(crate) fn of(settings: &Settings, sensor: &Sensor) -> Recipe {
        let tight = Extend {
            to_ground: false,
            away_from_sensor: None,
            end_faces: [None; 2],
            cut_top: None,
            size_min_m: SIZE_MIN_M,
        };
        let corrected = Recipe {
            seed: SeedRule::NearestToCenter,
            seeds: 1,
            merge: MergeRule::BetterFirst,
            removes_ground: true,
            height_max_m: f64::INFINITY,
            fit: settings.box_fit.unwrap_or(BoxFit::Closeness),
            extend: Extend {
                to_ground: true,
                ..tight
            },
            scales: None,
            keeps_known_apart: false,
            points_min: settings.points_min as usize,
            ranking: Ranking::InverseEds,
        };
        match settings.mode {
            Mode::Corrected => corrected,
            Mode::Literal => Recipe {
                seed: SeedRule::RandomInside,
                merge: MergeRule::LargerFirst,
                removes_ground: false,
                fit: settings.box_fit.unwrap_or(BoxFit::AxisAligned),
                extend: tight,
                points_min: 1,
                ..corrected
            },
            Mode::None => Recipe {
                merge: MergeRule::KnownOnly,
                points_min: 0,
                ..corrected
            },
            Mode::Distance | Mode::Dbscan | Mode::Euclidean => Recipe {
                seeds: 4,
                height_max_m: settings.ground.height_max_m,
                extend: Extend {
                    away_from_sensor: Some(Side {
                        least_m: 0.0,
                        share: settings.distance.width_share_min,
                        most_m: settings.distance.width_most_m,
                    }),
                    end_faces: end_faces(&settings.distance),
                    cut_top: cut_top(&settings.distance, sensor),
                    ..corrected.extend
                },
                scales: (settings.mode == Mode::Distance).then_some(Scales {
                    upright: settings.distance.upright_scale,
                    upright_apart_m: settings.distance.upright_apart_m,
                    limits: SizeLimits {
                        low_m: settings.distance.shrink_above_m,
                        tall_from_m: settings.distance.tall_from_m,
                        tall_m: settings.distance.tall_above_m,
                    },
                    shrink_factor: settings.distance.shrink_factor,
                    shrink_attempts: settings.distance.shrink_attempts,
                }),
                keeps_known_apart: true,
                ranking: match sensor.unknown_logit_at {
                    Some(at) => Ranking::Unknown(at),
                    None => Ranking::Objectness,
                },
                ..corrected
            },
        }
    }
}

/// A car's or van's end, and a truck's.
fn end_faces(settings: &DistanceSettings) -> [Option<EndFace>; 2] {
    let aside_max_rad = settings.end_face_aside_max_deg.to_radians();
    let face = |width_m, height_min_m, share| {
        (share > 0.0).then_some(EndFace {
            width_m,
            height_min_m,
            aside_max_rad,
            share,
            top_share_min: settings.end_face_top_share_min,
        })
    };
    let truck_width_m = [settings.end_face_width_m[1], settings.width_most_m + 0.5];
    [
        face(settings.end_face_width_m, 1.0, settings.end_face_share),
        face(
            truck_width_m,
            settings.truck_height_min_m,
            settings.truck_end_share,
        ),
    ]
}

/// For a sensor whose beams are known.
fn cut_top(settings: &DistanceSettings, sensor: &Sensor) -> Option<CutTop> {
    /// Returns of the topmost two beams or so, rad: beams of one sensor differ from the table by about 0.1 degrees.
    const MARGIN_RAD: f64 = 0.009;
    let top = sensor.beams.as_ref()?.elevation_rad.first()?;
    (settings.cut_top_height_m > 0.0).then_some(CutTop {
        elevation_rad: f64::from(*top) - MARGIN_RAD,
        length_min_m: 3.0,
        seen_min_m: settings.tall_from_m,
        height_m: settings.cut_top_height_m,
    })
}

/// The growing algorithm of a mode; `None` for the proposal as it is.
pub(crate) fn clusterer(settings: &Settings, sensor: &Sensor) -> Option<Box<dyn Clusterer>> {
    match settings.mode {
        Mode::Literal => Some(Box::new(Literal::new(&settings.literal))),
        Mode::Corrected => Some(Box::new(Depth::new(
            &settings.corrected,
            sensor.beams.as_ref(),
        ))),
        Mode::Distance => Some(Box::new(Distance::new(&settings.distance))),
        Mode::Dbscan => Some(Box::new(Dbscan::new(&settings.reference))),
        Mode::Euclidean => Some(Box::new(Euclidean::new(&settings.reference))),
        Mode::None => None,
    }
}
