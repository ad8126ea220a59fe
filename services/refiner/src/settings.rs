//! Settings with their units; every default says where its number comes from.

use mluc_model::LOOKS;
use serde::{Deserialize, Serialize};

use crate::fit::BoxFit;
use crate::{HullSettings, RefinerError, Sensor};

/// How a cluster is grown, and the rules around it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// The paper's algorithm 1 to the letter.
    Literal,
    /// Algorithm 1 with the sign turned, ground removed, and an oriented box.
    #[serde(alias = "depth")]
    Corrected,
    /// Join distance that grows with range, local ground, shrink, oriented box.
    #[default]
    #[serde(alias = "improved")]
    Distance,
    /// DBSCAN (Ester et al., 1996) on what stands above the ground: a known reference.
    Dbscan,
    /// Euclidean clusters of one fixed tolerance above the ground: a known reference.
    Euclidean,
    /// The proposal box as it is.
    None,
}

impl Mode {
    /// All, the paper's first.
    pub const ALL: [Mode; 6] = [
        Mode::Literal,
        Mode::Corrected,
        Mode::Distance,
        Mode::Dbscan,
        Mode::Euclidean,
        Mode::None,
    ];

    /// The word in the settings.
    pub fn name(self) -> &'static str {
        match self {
            Mode::Literal => "literal",
            Mode::Corrected => "corrected",
            Mode::Distance => "distance",
            Mode::Dbscan => "dbscan",
            Mode::Euclidean => "euclidean",
            Mode::None => "none",
        }
    }

    /// By name; `improved` is another name of `distance`, `depth` of `corrected`.
    pub fn from_name(name: &str) -> Option<Mode> {
        match name {
            "improved" => Some(Mode::Distance),
            "depth" => Some(Mode::Corrected),
            _ => Mode::ALL.into_iter().find(|mode| mode.name() == name),
        }
    }
}

/// Everything that can be set of the refiner.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Which algorithm.
    pub mode: Mode,
    /// Radius r of the cylinder around the seed, m. Unset: the paper's 4 m where the model sees all around (its
    /// industrial park) and 5 m where it looks ahead (KITTI); 5 m everywhere in `distance`, `dbscan` and `euclidean`.
    pub radius_m: Option<f64>,
    /// How the rectangle is laid. Unset: along the axes for literal, by closeness for the others.
    pub box_fit: Option<BoxFit>,
    /// A cluster with fewer points is no object. 8 in the modes with an oriented box; literal has no such rule.
    pub points_min: u32,
    /// A cluster longer than this, m, is no road user (a truck with its trailer is below).
    pub length_max_m: f64,
    /// Points that one candidate may look at; beyond it they are thinned evenly, counted and flagged. 16,384: a car at
    /// 4 m has some 10,000.
    pub points_per_candidate_max: u32,
    /// Work that all candidates of a frame may cost: points looked at, as often as they are. Candidates whose turn comes
    /// later keep their proposal box, counted and flagged. Work is counted and not timed, so that equal input gives equal
    /// output.
    pub work_max: u64,
    /// Time that a frame may take where the sensor sets the pace, ms: kept by the stage, which has a clock. What is left
    /// over keeps its proposal box, counted and flagged. Three tenths of a 10 Hz sensor's period: far above what ordinary
    /// frames take (13 ms with the looks of clusters), so that it bites on a starved machine alone.
    pub time_max_ms: f64,
    /// The ground under each candidate.
    pub ground: GroundSettings,
    /// Whether unknown objects are ranked by the looks of the cluster that they lie on too ([`crate::Looks`]). Unset: where
    /// the model has learned it, in `distance`, `dbscan` and `euclidean`.
    pub looks: Option<bool>,
    /// Which sizes unknown objects may have.
    pub hull: HullSettings,
    /// For [`Mode::Literal`].
    pub literal: LiteralSettings,
    /// For [`Mode::Corrected`].
    pub corrected: CorrectedSettings,
    /// For [`Mode::Distance`].
    pub distance: DistanceSettings,
    /// For [`Mode::Dbscan`] and [`Mode::Euclidean`].
    pub reference: ReferenceSettings,
    /// Which boxes stay.
    pub merge: MergeSettings,
}

impl Default for Settings {
    fn default() -> Settings {
        Settings {
            mode: Mode::default(),
            radius_m: None,
            box_fit: None,
            points_min: 8,
            length_max_m: 16.0,
            points_per_candidate_max: 16_384,
            work_max: 2_500_000,
            time_max_ms: 30.0,
            ground: GroundSettings::default(),
            looks: None,
            hull: HullSettings::default(),
            literal: LiteralSettings::default(),
            corrected: CorrectedSettings::default(),
            distance: DistanceSettings::default(),
            reference: ReferenceSettings::default(),
            merge: MergeSettings::default(),
        }
    }
}

/// A plane through the lowest points around a candidate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GroundSettings {
    /// Lowest points of the cells within this distance carry the plane, m. 6 to 10 measure alike on simulated scans.
    pub radius_m: f64,
    /// Points lower than this above the plane belong to it, m. 0.1 to 0.2 measure alike there.
    pub clearance_m: f64,
    /// Points higher than this above the plane hang over the road, m: branches, bridges, signs.
    pub height_max_m: f64,
}

impl Default for GroundSettings {
    fn default() -> GroundSettings {
        GroundSettings {
            radius_m: 8.0,
            clearance_m: 0.15,
            height_max_m: 4.5,
        }
    }
}

/// Algorithm 1 as printed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LiteralSettings {
    /// Neighbours N(t): points closer than this in space, m. The paper leaves it open.
    pub neighbour_m: f64,
    /// lambda_theta, degrees: joined when the angle is below (paper).
    pub angle_max_deg: f64,
    /// Rotated bird's-eye overlap above which the smaller box goes. The paper names neither measure nor threshold.
    pub nms_iou: f64,
}

impl Default for LiteralSettings {
    fn default() -> LiteralSettings {
        LiteralSettings {
            neighbour_m: 0.5,
            angle_max_deg: 65.0,
            nms_iou: 0.01,
        }
    }
}

/// Algorithm 1 with the sign of the original depth clustering (Bogoslavskyi and Stachniss, 2016).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CorrectedSettings {
    /// Joined when the angle is above, degrees. On real scans 10 keeps 94 % of the pairs on one object and joins 1 %
    /// across a border; 25 is the complement of the printed 65.
    pub angle_min_deg: f64,
    /// Empty pixels passed over in each direction of the range image: missing returns split cars otherwise.
    pub gap_pixels: u32,
    /// Without a beam table, neighbours lie closer than `fallback_m` + `fallback_per_range` x range, m.
    pub fallback_m: f64,
    /// m per m of range.
    pub fallback_per_range: f64,
}

impl Default for CorrectedSettings {
    fn default() -> CorrectedSettings {
        CorrectedSettings {
            angle_min_deg: 10.0,
            gap_pixels: 2,
            fallback_m: 0.3,
            fallback_per_range: 0.01,
        }
    }
}

/// Join distance `join_m` + `join_per_range` x range, at most `join_max_m`; all tuned on simulated validation scans
/// (`docs/refiner.md`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DistanceSettings {
    /// At the sensor, m.
    pub join_m: f64,
    /// m per m of range: the gap between beams and columns grows with it.
    pub join_per_range: f64,
    /// Upper bound, m.
    pub join_max_m: f64,
    /// A cluster larger than this (l, w, h, m: a large van) is grown again with a shorter join distance,
    pub shrink_above_m: [f64; 3],
    /// unless it is at least this high, m,
    pub tall_from_m: f64,
    /// and not larger than this (l, w, h, m: a truck).
    pub tall_above_m: [f64; 3],
    /// Factor on the join distance of each further attempt.
    pub shrink_factor: f64,
    /// Attempts after the first.
    pub shrink_attempts: u32,
    /// Factor on the join distance of the very first attempt, whose cluster is taken when it stands upright: people
    /// beside each other are joined otherwise. 0: no such attempt.
    pub upright_scale: f64,
    /// Within this size (l, w, h, m) a cluster is taken apart only when all its parts stand upright: the mast of a forklift
    /// and the rider of a bicycle do, the rest of them does not.
    pub upright_apart_m: [f64; 3],
    /// The side away from the sensor is at least this share of the other one: it is never seen whole.
    pub width_share_min: f64,
    /// but need not be more than this, m: no road user is wider.
    pub width_most_m: f64,
    /// A face of this width, m, seen from the end, belongs to a vehicle,
    pub end_face_width_m: [f64; 2],
    /// provided that the line of sight is at most this far off the vehicle's length, degrees: its side is seen otherwise;
    pub end_face_aside_max_deg: f64,
    /// which is at least this share of its width long. 0: no such rule.
    pub end_face_share: f64,
    /// The upper third of such a face is at least this share of its width wide: a cyclist seen from the side is not.
    pub end_face_top_share_min: f64,
    /// A wider face that is at least this high, m, belongs to a truck,
    pub truck_height_min_m: f64,
    /// which is at least this share of its width long. 0: no such rule.
    pub truck_end_share: f64,
    /// What is at least 3 m long and `tall_from_m` high and reaches the sensor's topmost beams goes on above them: up to
    /// this height above the ground, m. 0: no such rule.
    pub cut_top_height_m: f64,
}

impl Default for DistanceSettings {
    fn default() -> DistanceSettings {
        DistanceSettings {
            join_m: 0.4,
            join_per_range: 0.0175,
            join_max_m: 1.2,
            shrink_above_m: [7.0, 2.8, 4.0],
            tall_from_m: 2.0,
            tall_above_m: [14.0, 3.5, 4.5],
            shrink_factor: 0.6,
            shrink_attempts: 2,
            upright_scale: 0.5,
            upright_apart_m: [3.4, 1.9, 2.6],
            width_share_min: 0.4,
            width_most_m: 2.8,
            end_face_width_m: [1.1, 2.1],
            end_face_aside_max_deg: 30.0,
            end_face_share: 2.2,
            end_face_top_share_min: 0.6,
            truck_height_min_m: 2.4,
            truck_end_share: 3.0,
            cut_top_height_m: 3.2,
        }
    }
}

/// The two known references.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ReferenceSettings {
    /// Euclidean: points closer than this are joined, m. 0.5: a usual choice for vehicles.
    pub tolerance_m: f64,
    /// DBSCAN: radius of a neighbourhood, m.
    pub epsilon_m: f64,
    /// DBSCAN: points within it, itself included, that make a core point.
    pub core_points: u32,
}

impl Default for ReferenceSettings {
    fn default() -> ReferenceSettings {
        ReferenceSettings {
            tolerance_m: 0.5,
            epsilon_m: 0.6,
            core_points: 5,
        }
    }
}

/// Which unknown boxes stay beside each other and beside known objects.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MergeSettings {
    /// Intersection over the smaller area above which the weaker unknown goes.
    pub overlap_max: f64,
    /// Only known objects with at least this score suppress.
    pub known_score_min: f32,
    /// Points this far outside of such a box still count as its own, m: the noise of box and points.
    pub known_margin_m: f64,
    /// An unknown goes when more than this share of its points lies in one such known box,
    pub known_points_share: f64,
    /// or when their bird's-eye IoU is above this.
    pub known_iou: f64,
}

impl Default for MergeSettings {
    fn default() -> MergeSettings {
        MergeSettings {
            overlap_max: 0.5,
            known_score_min: 0.5,
            known_margin_m: 0.1,
            known_points_share: 0.5,
            known_iou: 0.3,
        }
    }
}

impl Settings {
    /// Whether clusters are judged by their looks, with a model that has learned it or not.
    pub(crate) fn judges(&self, is_learned: bool) -> Result<bool, RefinerError> {
        match (self.looks, is_learned) {
            (Some(true), false) => Err(RefinerError::NoLooks { tensor: LOOKS }),
            (Some(judges), _) => Ok(judges),
            (None, _) => Ok(is_learned && self.ranks()),
        }
    }

    /// Whether unknown objects must have the size of a road user, where clusters are judged or not, and where the model's head
    /// is an open one or not.
    pub(crate) fn sizes(&self, judges: bool, is_open: bool) -> bool {
        let default = judges || is_open && self.ranks();
        self.hull.applies.unwrap_or(default)
    }

    /// Whether unknown objects have a score of our own, not the paper's.
    fn ranks(&self) -> bool {
        matches!(self.mode, Mode::Distance | Mode::Dbscan | Mode::Euclidean)
    }

    /// The paper's radius for this sensor, unless set.
    pub(crate) fn radius_for(&self, sensor: &Sensor) -> f64 {
        let default = match self.mode {
            Mode::Distance | Mode::Dbscan | Mode::Euclidean => 5.0,
            _ if sensor.sees_all_around => 4.0,
            _ => 5.0,
        };
        self.radius_m.unwrap_or(default)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_are_sound_and_nonsense_is_named() {
        assert_eq!(Settings::default().check(), Ok(()));
        let mut settings = Settings::default();
        settings.distance.join_m = f64::NAN;
        let fault = settings.check().expect_err("a length that is no number");
        assert!(fault.to_string().contains("distance.join_m"), "{fault}");
        let far = Settings {
            radius_m: Some(31.0),
            ..Settings::default()
        };
        assert!(far.check().is_err());
    }

    #[test]
    fn the_papers_radius_follows_the_model() {
        let mut sensor = Sensor::plain(&["car"]);
        let of = |mode| Settings {
            mode,
            ..Settings::default()
        };
        assert_eq!(of(Mode::Corrected).radius_for(&sensor), 4.0);
        sensor.sees_all_around = false;
        assert_eq!(of(Mode::Literal).radius_for(&sensor), 5.0);
        assert_eq!(of(Mode::Distance).radius_for(&sensor), 5.0);
        let set = Settings {
            radius_m: Some(3.0),
            ..Settings::default()
        };
        assert_eq!(set.radius_for(&sensor), 3.0);
    }

    #[test]
    fn every_mode_has_its_name() {
        for mode in Mode::ALL {
            assert_eq!(Mode::from_name(mode.name()), Some(mode));
        }
        assert_eq!(Mode::from_name("improved"), Some(Mode::Distance));
        assert_eq!(Mode::from_name("patchwork"), None);
    }
}
