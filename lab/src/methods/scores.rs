//! What a method gates by: low is unknown.

use mluc_head::Detection;

/// Distance of a box from the known, as a number that is low for the unknown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UnknownScore {
    /// The normalised EDS (paper section 3.2).
    Eds,
    /// The largest class probability.
    Msp,
    /// One minus the probability of being none of the known.
    Known,
}

impl UnknownScore {
    /// Of a box.
    pub fn of(self, detection: &Detection, classes: usize, has_logit: bool) -> f32 {
        match self {
            UnknownScore::Eds => detection.eds_normalised,
            UnknownScore::Msp => detection.softmax_max,
            UnknownScore::Known => 1.0 - unknown_probability(detection, classes, has_logit),
        }
    }

    /// What orders unknown objects among each other where nothing else does: the paper's 1 / EDS, or 1 - the probability.
    pub fn rank(self, detection: &Detection) -> f32 {
        match self {
            UnknownScore::Eds => 1.0 / detection.eds.max(1e-6),
            UnknownScore::Msp | UnknownScore::Known => 1.0 - detection.softmax_max,
        }
    }
}

/// Distances to the nearest prototype around which a box is as likely known as not, and the width of that step: between the
/// prototype's 0 and the midpoint's 0.5.
const DELTA_HALF: f32 = 0.25;
const DELTA_WIDTH: f32 = 0.08;

/// The probability that a box holds none of the known classes: of the head's own logit where it has one, else of the distance to the
/// nearest prototype.
pub fn unknown_probability(detection: &Detection, classes: usize, has_logit: bool) -> f32 {
    let logit = match has_logit {
        true => detection.embedding.get(classes).copied().unwrap_or(0.0),
        false => (detection.delta - DELTA_HALF) / DELTA_WIDTH,
    };
    1.0 / (1.0 + (-logit).exp())
}
