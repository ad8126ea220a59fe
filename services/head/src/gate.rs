//! The gate between knowns and candidate unknowns (paper section 3.2).

use mluc_ipc_types::DetectionKind;

/// A box whose embedding lies near the prototypes' centre, e < threshold, belongs to no known class. e is never below 1:
/// a threshold of 1 or less is the closed-set detector.
pub fn gate(eds_normalised: f32, threshold: f32) -> DetectionKind {
    if eds_normalised < threshold {
        DetectionKind::Candidate
    } else {
        DetectionKind::Known
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn below_the_threshold_is_a_candidate() {
        assert_eq!(gate(1.2, 1.5), DetectionKind::Candidate);
        assert_eq!(gate(1.5, 1.5), DetectionKind::Known);
        assert_eq!(gate(1.0, 0.0), DetectionKind::Known);
    }
}
