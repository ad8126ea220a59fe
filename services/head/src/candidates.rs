//! Selects the anchors that enter suppression: the best anchors whose objectness is at least the threshold.
//!
//! The product with a class probability is not used: it would drop the unknowns before the gate gets them.

/// An anchor that may contain an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Candidate {
    /// Sigmoid of the logit.
    pub(crate) objectness: f32,
    pub(crate) row: u32,
    /// Anchor of that row's cell.
    pub(crate) anchor: u32,
    /// Position of the row among the rows with a candidate.
    pub(crate) place: u32,
    /// Logit of the unknown, if the head has one; for a kept box, after the vote, the mean.
    pub(crate) unknown: Option<f32>,
}

pub(crate) fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}

/// Fills `candidates` with the best anchors, best first; ties go to the lower row and anchor. Returns how many anchors
/// passed the threshold, and how many logits are NaN; NaN is below every threshold.
pub(crate) fn select(
    logits: &[f32],
    anchors: usize,
    objectness_min: f32,
    candidates_max: usize,
    candidates: &mut Vec<Candidate>,
) -> (usize, usize) {
    // The comparison of logits is exact enough to reject nearly all anchors; the exact comparison follows.
    let logit_min = (objectness_min / (1.0 - objectness_min)).ln() - 0.01;
    candidates.clear();
    let numbered = logits.iter().enumerate();
    let likely = numbered.filter(|(_, logit)| **logit >= logit_min || logit.is_nan());
    let likely = likely.map(|(number, logit)| Candidate {
        objectness: sigmoid(*logit),
        row: (number / anchors) as u32,
        anchor: (number % anchors) as u32,
        place: 0,
        unknown: None,
    });
    let mut damaged = 0;
    candidates.extend(likely.filter(|candidate| {
        damaged += usize::from(candidate.objectness.is_nan());
        candidate.objectness >= objectness_min
    }));
    let found = candidates.len();
    let best_first = |a: &Candidate, b: &Candidate| {
        let by_place = (a.row, a.anchor).cmp(&(b.row, b.anchor));
        b.objectness.total_cmp(&a.objectness).then(by_place)
    };
    if found > candidates_max {
        candidates.select_nth_unstable_by(candidates_max, best_first);
        candidates.truncate(candidates_max);
    }
    candidates.sort_unstable_by(best_first);
    (found, damaged)
}

/// The largest of each `classes` logits, one for each anchor of a sigmoid head.
pub(crate) fn reduce_classes(logits: &[f32], classes: usize, largest: &mut Vec<f32>) {
    largest.clear();
    // A NaN loses against any other logit.
    let most = |anchor: &[f32]| anchor.iter().copied().fold(f32::NAN, f32::max);
    largest.extend(logits.chunks_exact(classes).map(most));
}
