//! What a method gates by: low is unknown.

use mluc_head::Detection;

/// Distance of a box from the known, as a number that is low for the unknown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UnknownScore {
    /// The normalised EDS (paper section 3.2).
    Eds,
    /// The largest class probability.
    Msp,
}

impl UnknownScore {
    /// Of a box.
    pub fn of(self, detection: &Detection) -> f32 {
        match self {
            UnknownScore::Eds => detection.eds_normalised,
            UnknownScore::Msp => detection.softmax_max,
        }
    }

    /// What orders unknown objects among each other where nothing else does: the paper's 1 / EDS, or 1 - the probability.
    pub fn rank(self, detection: &Detection) -> f32 {
        match self {
            UnknownScore::Eds => 1.0 / detection.eds.max(1e-6),
            UnknownScore::Msp => 1.0 - detection.softmax_max,
        }
    }
}
