//! Decides which unknown boxes are kept (the last line of the paper's algorithm 1, and what it leaves open).

use crate::{Variant, proposal::Proposal};
use mluc_geometry::{Box3, Inside, intersection_over_min_area, iou_bev};
use mluc_ipc_types::{Disposition, Point};

/// Intersection over the smaller area above which the weaker unknown object is suppressed.
const OVERLAP_MAX: f64 = 0.5;
/// Points at most this far outside the box of a sure known object still belong to it, m: the noise of box and points.
pub(crate) const KNOWN_MARGIN_M: f64 = 0.1;
/// An unknown object is suppressed when more than this share of its points lies in one such known box.
const KNOWN_POINTS_SHARE: f64 = 0.5;
/// It is also suppressed when the bird's-eye IoU of the two boxes is above this, and a point of it lies at most this far from the known box, m.
const KNOWN_IOU: f64 = 0.3;
const KNOWN_NEAR_M: f64 = 0.5;
/// The paper's variant: rotated bird's-eye overlap above which the smaller box is suppressed. The paper names neither measure nor threshold.
const PAPER_NMS_IOU: f64 = 0.01;

/// Suppresses overlapping unknown objects by the variant's rules. `points`: the points of the proposals by their ranges. `order`: a buffer.
pub(crate) fn merge(
    proposals: &mut [Proposal],
    points: &[u32],
    scan: &[Point],
    variant: Variant,
    order: &mut Vec<usize>,
) {
    if variant != Variant::Paper {
        clash_with_known(proposals, points, scan);
    }
    match variant {
        // As printed: larger boxes first, and known objects do not suppress.
        Variant::Paper => {
            best_first(order, proposals, |d| d.shape.volume_m3());
            suppress(proposals, order, iou_bev, PAPER_NMS_IOU);
        }
        Variant::PaperCorrected | Variant::RangeScaled => {
            best_first(order, proposals, |d| f64::from(d.score));
            suppress(proposals, order, intersection_over_min_area, OVERLAP_MAX);
        }
        // The boxes are proposals: no unknown object suppresses another.
        Variant::None => {}
    }
}

/// The unknown objects that are not suppressed, best first; place and size decide ties, so the order of the detections does not matter.
pub(crate) fn best_first(order: &mut Vec<usize>, all: &[Proposal], of: impl Fn(&Proposal) -> f64) {
    order.clear();
    order.extend((0..all.len()).filter(|&i| all[i].is_standing()));
    order.sort_unstable_by(|&a, &b| {
        let (a, b) = (&all[a], &all[b]);
        let place = |d: &Proposal| [d.shape.center_m, d.shape.size_m];
        let places = place(a).partial_cmp(&place(b));
        (of(b).total_cmp(&of(a)))
            .then(places.unwrap_or(std::cmp::Ordering::Equal))
            .then(a.detection.cmp(&b.detection))
    });
}

/// Greedy: a box is suppressed when a kept box covers it by more than a limit.
fn suppress(
    proposals: &mut [Proposal],
    order: &[usize],
    overlap: impl Fn(&Box3, &Box3) -> f64,
    limit: f64,
) {
    for (rank, &index) in order.iter().enumerate() {
        let own = proposals[index].shape;
        let better = order[..rank].iter().map(|&better| &proposals[better]);
        let by = better.filter(|d| d.is_standing()).find_map(|better| {
            let overlap = overlap(&better.shape, &own);
            (overlap > limit).then_some((better.detection, overlap))
        });
        if let Some((by, overlap)) = by {
            proposals[index].suppress(Disposition::OverlapsUnknown, by, overlap);
        }
    }
}

/// Suppresses an unknown object when most of its points lie in a sure known box, or when their boxes overlap. Of several
/// such known objects, the one that covers most of it is recorded.
fn clash_with_known(proposals: &mut [Proposal], points: &[u32], scan: &[Point]) {
    for index in 0..proposals.len() {
        if !proposals[index].is_standing() {
            continue;
        }
        let unknown = &proposals[index];
        let own = &points[unknown.points.0..unknown.points.1];
        let known = proposals.iter().filter(|known| known.is_sure());
        let clashes =
            known.filter_map(|known| Some((known.detection, clash(unknown, known, own, scan)?)));
        let worst = clashes.reduce(|a, b| if b.1 > a.1 { b } else { a });
        if let Some((by, overlap)) = worst {
            proposals[index].suppress(Disposition::OverlapsKnown, by, overlap);
        }
    }
}

/// Finds, for each doubted known object, the best unknown object that stands where it lies.
pub(crate) fn find_rivals(proposals: &mut [Proposal]) {
    for index in 0..proposals.len() {
        let known = &proposals[index];
        if !known.is_known() || !known.is_doubted {
            continue;
        }
        let standing = proposals.iter().filter(|unknown| unknown.is_standing());
        let overlap = |unknown: &Proposal| iou_bev(&unknown.shape, &known.shape);
        let at_place = standing.filter(|unknown| overlap(unknown) > KNOWN_IOU);
        let best = at_place.max_by(|a, b| a.score.total_cmp(&b.score));
        let rival = best.map(|best| (best.detection, overlap(best) as f32));
        proposals[index].rival = rival;
    }
}

/// The share by which a known object covers an unknown one; `None` when it is too small to matter. The boxes count only if points of the unknown
/// object lie near the known box: what is in front of a car, completed away from the sensor, reaches into it.
fn clash(unknown: &Proposal, known: &Proposal, own: &[u32], scan: &[Point]) -> Option<f64> {
    // The cluster's points lie in its tight box; completing the unseen side moves the box by less than its size.
    let reach_m = 2.0 * unknown.shape.half_diagonal_m() + known.shape.half_diagonal_m();
    let [x, y] = [0, 1].map(|axis| unknown.shape.center_m[axis] - known.shape.center_m[axis]);
    if x.hypot(y) > reach_m {
        return None;
    }
    let share = |margin_m: f64| {
        let grown = Inside::of(&known.shape, margin_m);
        let inside = own.iter().filter_map(|&i| scan.get(i as usize));
        let inside = inside.filter(|p| grown.contains([p.x_m, p.y_m, p.z_m].map(f64::from)));
        inside.count() as f64 / own.len().max(1) as f64
    };
    let (covered, iou) = (share(KNOWN_MARGIN_M), iou_bev(&unknown.shape, &known.shape));
    let is_near = || own.is_empty() || share(KNOWN_NEAR_M) > 0.0;
    let is_clash = covered > KNOWN_POINTS_SHARE || (iou > KNOWN_IOU && is_near());
    is_clash.then_some(covered.max(iou))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_ipc_types::{Detection, DetectionKind};

    fn proposal(index: usize, kind: DetectionKind, x: f64, length: f64, score: f32) -> Proposal {
        let detection = Detection { kind: kind as u32, score, ..Detection::default() };
        let shape = Box3::new([x, 0.0, 0.0, length, 2.0, 1.5, 0.0]);
        Proposal::of_detection(index, &detection, shape, score)
    }

    fn dispositions(proposals: &[Proposal], variant: Variant) -> Vec<(Disposition, Option<usize>)> {
        let mut proposals = proposals.to_vec();
        merge(&mut proposals, &[], &[], variant, &mut Vec::new());
        let is_covered = |d: &Proposal| d.overlap > 0.0 && d.overlap <= 1.0;
        let told = |d: &Proposal| d.suppressed_by.is_some() == is_covered(d);
        assert!(proposals.iter().all(told), "who covers it says by how much");
        proposals.iter().map(|d| (d.disposition, d.suppressed_by)).collect()
    }

    use DetectionKind::{Candidate, Known};

    const STAYS: (Disposition, Option<usize>) = (Disposition::Published, None);

    #[test]
    fn the_better_of_two_unknowns_stays() {
        let proposals = [
            proposal(0, Candidate, 0.0, 6.0, 0.2),
            proposal(1, Candidate, 0.5, 4.0, 0.9),
            proposal(2, Candidate, 20.0, 4.0, 0.1),
        ];
        let goes = |by| (Disposition::OverlapsUnknown, Some(by));
        let found = dispositions(&proposals, Variant::RangeScaled);
        assert_eq!(found, [goes(1), STAYS, STAYS]);
        let found = dispositions(&proposals, Variant::Paper);
        assert_eq!(found, [STAYS, goes(0), STAYS]);
        // What is suppressed suppresses nothing.
        let chain = [(0, 0.0, 0.9), (1, 1.5, 0.5), (2, 3.0, 0.3)];
        let chain = chain.map(|(i, x, score)| proposal(i, Candidate, x, 4.0, score));
        let found = dispositions(&chain, Variant::RangeScaled);
        assert_eq!(found, [STAYS, goes(0), STAYS]);
    }

    #[test]
    fn a_sure_known_object_suppresses_and_an_unsure_one_does_not() {
        let goes = (Disposition::OverlapsKnown, Some(0));
        for (variant, score, expected) in [
            (Variant::RangeScaled, 0.8, goes),
            (Variant::RangeScaled, 0.4, STAYS),
            (Variant::Paper, 0.9, STAYS),
        ] {
            let known = proposal(0, Known, 0.0, 4.0, score);
            let both = [known, proposal(1, Candidate, 0.3, 4.0, 0.9)];
            assert_eq!(dispositions(&both, variant)[1], expected, "{score}");
        }
    }
}
