//! Decides which objects are unknown, their scores, and the reasons: the only place that decides.
//!
//! 1. **Gate** (paper section 3.2, in the head): a detection is known or a candidate.
//! 2. **Cluster**: a candidate without points is `too_few_points`; a candidate on a known object's points is `overlaps_known`.
//! 3. **Score**: the proposal's score (how sure the network is that an object is there and that it is none of the known
//!    classes) times the cluster's score (how likely it drives or walks). If the size is no road user's, the second factor
//!    is 0.05 instead, and a flag gives the reason: the object stays, behind all others.
//! 4. **Disposition**: an object that the robot's owner allows it to drive over is `undersized`; then sure known objects and
//!    better unknown objects suppress the objects that they cover ([`crate::merge`]).
//! 5. **Profile**: a remaining object, known or unknown, is `low_score` if it is below the scores of the operating profile.
//!    All others are published.
//! 6. **Reading**: with P(unknown), a candidate that has a class has two readings, unknown and known; one is published
//!    ([`crate::RefinerOutput::choose_readings`]). A doubted known object gives way to a published unknown one at its place.

use crate::proposal::Proposal;
use crate::{ClusterScorer, RefinerError, RobotSettings, Sensor, Settings, priors};
use mluc_geometry::Box3;
use mluc_ipc_types::{Detection, Disposition, Object, ObjectKind};
use mluc_model::ScoreMin;

/// Factor on the score of an unlikely object, and the minimum of a cluster's score.
const UNLIKELY: f32 = 0.05;
/// Exponent of P(unknown). A sure object that may be unknown is mostly a known one, so the probability counts more than the objectness.
/// The best of 1, 2, 3, 5 and 9 on the validation scans of all three families.
const UNKNOWN_POWER: i32 = 3;

/// P(unknown) from which a known object is doubted. On simulated validation 0.2 to 0.5 are equal.
const DOUBTED_FROM: f32 = 0.3;

/// Scores unknown objects and decides which sizes count.
#[derive(Debug)]
pub(crate) struct UnknownScorer {
    is_ours: bool,
    /// Whether detections have a probability of being none of the known classes.
    tells_unknown: bool,
    cluster: Option<ClusterScorer>,
    ranks_sizes: bool,
    robot: RobotSettings,
}

impl UnknownScorer {
    /// `cluster`: layers that score clusters. The settings may disable them; it is an error if the settings require them and there are none.
    pub(crate) fn new(
        settings: &Settings,
        sensor: &Sensor,
        cluster: Option<ClusterScorer>,
    ) -> Result<UnknownScorer, RefinerError> {
        let is_ours = settings.is_ours();
        if settings.study.scores_clusters == Some(true) && cluster.is_none() {
            let expected = format!("a model with the tensor {}", mluc_model::CLUSTER_SCORER);
            let what = "scores of clusters";
            return Err(RefinerError::new(what, expected, "none in it"));
        }
        let cluster = cluster.filter(|_| settings.study.scores_clusters.unwrap_or(is_ours));
        let ranks_sizes = is_ours && (cluster.is_some() || sensor.tells_unknown);
        Ok(UnknownScorer {
            is_ours,
            tells_unknown: sensor.tells_unknown,
            ranks_sizes: settings.study.ranks_sizes.unwrap_or(ranks_sizes),
            cluster,
            robot: settings.robot,
        })
    }

    /// The score of a candidate before its cluster is known. Finite; 0 if the detection's numbers are invalid.
    pub(crate) fn score_candidate(&self, detection: &Detection) -> f32 {
        /// Far above every score that a model gives.
        const SCORE_MAX: f32 = 1e6;
        let score = if self.is_ours && self.tells_unknown {
            // Objectness x P(none of the known)^3.
            detection.objectness * detection.unknown_probability.max(0.0).powi(UNKNOWN_POWER)
        } else if self.is_ours {
            // Objectness x (2 - e), both 0 to 1: something is there, and it lies between the prototypes.
            detection.objectness * (2.0 - detection.eds_normalised).clamp(0.0, 1.0)
        } else if detection.eds > 0.0 {
            // The paper ranks by -EDS. Boxes of background have the lowest EDS of all and come first.
            (1.0 / detection.eds).min(SCORE_MAX)
        } else {
            0.0
        };
        if score.is_finite() { score } else { 0.0 }
    }

    /// Whether a candidate has a known reading too: P(unknown) says that it may be known, the paper's gate does not.
    pub(crate) fn reads_twice(&self) -> bool {
        self.is_ours && self.tells_unknown
    }

    /// Whether a known object may be unknown after all: then it takes no points from unknown objects and suppresses none.
    pub(crate) fn doubts(&self, detection: &Detection) -> bool {
        let may_be = detection.unknown_probability >= DOUBTED_FROM;
        self.reads_twice() && may_be && !detection.is_candidate()
    }

    pub(crate) fn reads_clusters(&self) -> bool {
        self.cluster.is_some()
    }

    /// Score and flags of an unknown object from its box and its cluster's measurements.
    pub(crate) fn score(&self, proposal: &mut Proposal) {
        let unseen_m = proposal.measures.map_or(0.0, |m| m.beam_gap_m);
        let reason = size_reason(&proposal.shape, unseen_m.into()).filter(|_| self.ranks_sizes);
        proposal.flags |= reason.unwrap_or(0);
        proposal.score *= match (reason, &self.cluster, &proposal.measures) {
            (Some(_), ..) => UNLIKELY,
            (None, Some(scorer), Some(measures)) => scorer.score(measures).max(UNLIKELY),
            (None, ..) => 1.0,
        };
    }

    /// An object that the robot's owner allows it to drive over is not published.
    pub(crate) fn decide(&self, proposal: &mut Proposal) {
        let [length, width, seen_m] = proposal.shape.size_m;
        // Its top may be higher by the gap between two beams.
        let height = seen_m + proposal.measures.map_or(0.0, |m| m.beam_gap_m.into());
        if height < self.robot.height_min_m || length.min(width) < self.robot.width_min_m {
            proposal.disposition = Disposition::Undersized;
        }
    }

    /// Lowers the score of an unrefined candidate, if clusters are scored: its box gives no size, so it comes behind all refined candidates.
    pub(crate) fn score_unrefined(&self, proposal: &mut Proposal) {
        if self.reads_clusters() {
            proposal.score *= UNLIKELY;
        }
    }
}

/// Marks objects below the profile's scores as `low_score`. Objects suppressed by an unknown object stay suppressed: their scores are lower.
pub(crate) fn leave_out_low_scores(proposals: &mut [Proposal], score_min: ScoreMin) {
    for proposal in proposals {
        let least = match proposal.kind {
            ObjectKind::Known => score_min.known,
            ObjectKind::Unknown => score_min.unknown,
        };
        if proposal.disposition == Disposition::Published && proposal.score < least {
            proposal.disposition = Disposition::LowScore;
        }
    }
}

/// The flag that gives the reason why a box does not have a road user's size; else `None`. Its top may be `unseen_m` higher than seen.
fn size_reason(shape: &Box3, unseen_m: f64) -> Option<u32> {
    let [length, width, height] = shape.size_m;
    let whole_m = [length, width, height + unseen_m];
    let [post_side_m, post_height_m] = priors::POST_M;
    let mut seen = shape.size_m.iter().zip(priors::ROAD_USER_M);
    let mut whole = whole_m.iter().zip(priors::ROAD_USER_M);
    if seen.any(|(size, [_, most])| *size > most) {
        Some(Object::LARGE)
    } else if whole.any(|(size, [least, _])| *size < least) {
        Some(Object::SMALL)
    } else if length.max(width) < post_side_m && height > post_height_m {
        // Too high for its length and width: a post, a sign, a trunk.
        Some(Object::POST)
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clusters::Measures;

    #[test]
    fn sizes_of_walls_posts_and_kerbs_have_a_reason_and_carts_have_none() {
        let cases = [
            ([2.6, 1.3, 1.9], 0.0, 0),
            ([15.0, 0.2, 2.0], 0.0, Object::LARGE),
            ([0.5, 0.2, 2.0], 0.0, Object::SMALL),
            ([4.0, 1.0, 0.3], 0.0, Object::SMALL),
            ([0.8, 0.9, 2.3], 0.0, Object::POST),
            // A tall person, a person on a scooter, a forklift from its narrow side.
            ([0.6, 0.7, 1.95], 0.0, 0),
            ([1.3, 0.6, 2.1], 0.0, 0),
            ([0.5, 1.25, 2.2], 0.0, 0),
            // A car's lower part between beams that are close, and far apart. A gap never makes an object too high.
            ([1.3, 0.6, 0.6], 0.0, Object::SMALL),
            ([1.3, 0.6, 0.6], 0.9, 0),
            ([6.0, 2.5, 4.0], 0.9, 0),
        ];
        let mut sensor = Sensor::plain(&["car"]);
        sensor.tells_unknown = true;
        let scorer = UnknownScorer::new(&Settings::default(), &sensor, None).expect("settings");
        for ([l, w, h], beam_gap_m, expected) in cases {
            let shape = Box3::new([0.0, 0.0, 0.0, l, w, h, 0.3]);
            let mut proposal = Proposal::of_detection(0, &Detection::default(), shape, 0.5);
            proposal.measures = Some(Measures { beam_gap_m, ..Measures::default() });
            scorer.score(&mut proposal);
            assert_eq!(proposal.flags, expected, "{shape:?}");
        }
    }
}
