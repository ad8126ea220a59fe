//! Which unknown boxes stay (paper algorithm 1's last line, and what it leaves open).

use mluc_geometry::{Box3, intersection_over_min_area, iou_bev};
use mluc_ipc_types::{Fate, Point};

use crate::draft::Draft;
use crate::inside::Inside;
use crate::recipe::MergeRule;
use crate::settings::Settings;

/// Suppresses unknowns that overlap; `points` are the points of each draft by its range. `order` is a buffer.
pub(crate) fn merge(
    drafts: &mut [Draft],
    points: &[u32],
    scan: &[Point],
    rule: MergeRule,
    settings: &Settings,
    order: &mut Vec<usize>,
) {
    order.clear();
    order.extend((0..drafts.len()).filter(|&i| drafts[i].is_standing()));
    let rules = &settings.merge;
    match rule {
        MergeRule::LargerFirst => {
            sort_by(order, drafts, |d| d.shape.volume_m3());
            suppress(drafts, order, iou_bev, settings.literal.nms_iou);
        }
        MergeRule::BetterFirst => {
            clash_with_known(drafts, points, scan, settings);
            order.retain(|&i| drafts[i].is_standing());
            sort_by(order, drafts, |d| f64::from(d.score));
            suppress(drafts, order, intersection_over_min_area, rules.overlap_max);
        }
        MergeRule::KnownOnly => clash_with_known(drafts, points, scan, settings),
    }
}

/// Best first; ties by place, so that the order of the detections does not matter.
fn sort_by(order: &mut [usize], drafts: &[Draft], value: impl Fn(&Draft) -> f64) {
    order.sort_unstable_by(|&a, &b| {
        let (a, b) = (&drafts[a], &drafts[b]);
        let place = |d: &Draft| [d.shape.center_m, d.shape.size_m];
        value(b)
            .total_cmp(&value(a))
            .then_with(|| {
                place(a)
                    .partial_cmp(&place(b))
                    .unwrap_or(std::cmp::Ordering::Equal)
            })
            .then(a.detection.cmp(&b.detection))
    });
}

/// Greedy: a box goes when one that stays covers it by more than a limit.
fn suppress(
    drafts: &mut [Draft],
    order: &[usize],
    overlap: impl Fn(&Box3, &Box3) -> f64,
    limit: f64,
) {
    for (rank, &index) in order.iter().enumerate() {
        let own = drafts[index].shape;
        let by = order[..rank].iter().find_map(|&better| {
            let better = &drafts[better];
            if !better.is_standing() || are_apart(&better.shape, &own) {
                return None;
            }
            let overlap = overlap(&better.shape, &own);
            (overlap > limit).then_some((better.detection, overlap))
        });
        if let Some((by, overlap)) = by {
            drafts[index].suppress(Fate::OverlapsUnknown, by, overlap);
        }
    }
}

/// Whether two boxes cannot meet, seen from above: quicker than their overlap, which hundreds of boxes would ask for.
pub(crate) fn are_apart(a: &Box3, b: &Box3) -> bool {
    distance_m(a, b) > half_diagonal_m(a) + half_diagonal_m(b)
}

fn half_diagonal_m(shape: &Box3) -> f64 {
    shape.size_m[0].hypot(shape.size_m[1]) / 2.0
}

fn distance_m(a: &Box3, b: &Box3) -> f64 {
    (a.center_m[0] - b.center_m[0]).hypot(a.center_m[1] - b.center_m[1])
}

/// An unknown goes when most of its points lie in a sure known box, or when their boxes overlap; of several such known
/// objects the one that covers most of it says so.
fn clash_with_known(drafts: &mut [Draft], points: &[u32], scan: &[Point], settings: &Settings) {
    for index in 0..drafts.len() {
        if !drafts[index].is_standing() {
            continue;
        }
        let unknown = &drafts[index];
        let own = &points[unknown.points.0..unknown.points.1];
        let known = drafts.iter().filter(|known| {
            !known.is_unknown()
                && known.fate == Fate::Published
                && known.score >= settings.merge.known_score_min
        });
        let clashes = known.filter_map(|known| {
            let overlap = clash(unknown, known, own, scan, settings)?;
            Some((known.detection, overlap))
        });
        let worst = clashes.reduce(|a, b| if b.1 > a.1 { b } else { a });
        if let Some((by, overlap)) = worst {
            drafts[index].suppress(Fate::OverlapsKnown, by, overlap);
        }
    }
}

/// By how much a known object covers an unknown one; `None` when that is too little to matter.
fn clash(
    unknown: &Draft,
    known: &Draft,
    own: &[u32],
    scan: &[Point],
    settings: &Settings,
) -> Option<f64> {
    // Points of the cluster lie in its tight box, which growing to the unseen side moves by less than its size.
    let reach_m = 2.0 * half_diagonal_m(&unknown.shape) + half_diagonal_m(&known.shape);
    if distance_m(&unknown.shape, &known.shape) > reach_m {
        return None;
    }
    let grown = Inside::of(&known.shape, settings.merge.known_margin_m);
    let inside = own
        .iter()
        .filter_map(|&i| scan.get(i as usize))
        .filter(|p| grown.contains([p.x_m, p.y_m, p.z_m]))
        .count();
    let share = inside as f64 / own.len().max(1) as f64;
    let iou = iou_bev(&unknown.shape, &known.shape);
    let is_clash = share > settings.merge.known_points_share || iou > settings.merge.known_iou;
    is_clash.then_some(share.max(iou))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::draft::Ranking;
    use mluc_ipc_types::{Detection, DetectionKind};

    fn draft(index: usize, kind: DetectionKind, x: f64, length: f64, score: f32) -> Draft {
        let detection = Detection {
            kind: kind as u32,
            score,
            eds: 1.0 / score,
            ..Detection::default()
        };
        let shape = Box3::new([x, 0.0, 0.0, length, 2.0, 1.5, 0.0]);
        Draft::of_proposal(index, &detection, shape, Ranking::InverseEds)
    }

    fn fates(mut drafts: Vec<Draft>, rule: MergeRule) -> Vec<(Fate, Option<usize>)> {
        merge(
            &mut drafts,
            &[],
            &[],
            rule,
            &Settings::default(),
            &mut Vec::new(),
        );
        let told = |d: &Draft| d.by.is_some() == (d.overlap > 0.0 && d.overlap <= 1.0);
        assert!(drafts.iter().all(told), "who covers it says by how much");
        drafts.iter().map(|d| (d.fate, d.by)).collect()
    }

    use DetectionKind::{Candidate, Known};

    #[test]
    fn the_better_of_two_unknowns_stays() {
        let drafts = vec![
            draft(0, Candidate, 0.0, 6.0, 0.2),
            draft(1, Candidate, 0.5, 4.0, 0.9),
            draft(2, Candidate, 20.0, 4.0, 0.1),
        ];
        let stays = (Fate::Published, None);
        assert_eq!(
            fates(drafts.clone(), MergeRule::BetterFirst),
            [(Fate::OverlapsUnknown, Some(1)), stays, stays]
        );
        assert_eq!(
            fates(drafts, MergeRule::LargerFirst),
            [stays, (Fate::OverlapsUnknown, Some(0)), stays]
        );
    }

    #[test]
    fn a_sure_known_object_suppresses_and_an_unsure_one_does_not() {
        let case = |score| {
            let drafts = vec![
                draft(0, Known, 0.0, 4.0, score),
                draft(1, Candidate, 0.3, 4.0, 0.9),
            ];
            fates(drafts, MergeRule::BetterFirst)[1]
        };
        assert_eq!(case(0.8), (Fate::OverlapsKnown, Some(0)));
        assert_eq!(case(0.4), (Fate::Published, None));
        let literal = vec![
            draft(0, Known, 0.0, 4.0, 0.9),
            draft(1, Candidate, 0.3, 4.0, 0.9),
        ];
        assert_eq!(
            fates(literal, MergeRule::LargerFirst)[1],
            (Fate::Published, None)
        );
    }
}
