//! Matching of detections and labels: the devkit's greedy matching, at every threshold at once.
//!
//! The devkit matches twice. First it matches all detections, and a label takes the one with the highest score: these scores become the
//! thresholds. Then it matches at each threshold, and a label takes the detection that overlaps most. A frame's matching changes only where the threshold
//! crosses one of its own detections, so a frame is matched once for each of its detections. The sum of the changes gives the counts over all frames.
//!
//! Terms: a label or detection is *valid* when it counts, *ignored* when it may take part in a match that then counts neither way (too small, too occluded, a
//! neighbour class). Labels keep file order; a match needs an overlap strictly above the minimum of the class.

use crate::{ClassRule, Difficulty, LabelledFrame, Metric, curve::Curve, frame::score_of};
use mluc_dataset::Label;
use mluc_geometry::{iou_2d, iou_3d, iou_bev, overlap_of_first_2d};

/// A label that takes part.
struct Truth {
    valid: bool,
    /// Detections that overlap enough, in file order: index into the candidates, overlap.
    near: Vec<(usize, f64)>,
}

/// A detection that takes part.
struct Candidate {
    score: f64,
    valid: bool,
    /// In a region without labels, or outside the bin: it is not a false alarm when it is unmatched.
    is_excused: bool,
    /// Overlaps a label: only such a detection can change the matching.
    near_truth: bool,
}

/// For AP by a property of the objects: the bin of each label and of each detection of a frame. Labels outside the current bin may be
/// found or not; unmatched detections outside it are not counted.
pub(crate) type Binned = [Vec<usize>; 2];

/// Matches one frame, or only its objects in a bin.
pub(crate) fn match_frame(
    frame: &LabelledFrame,
    rule: &ClassRule,
    metric: Metric,
    difficulty: Difficulty,
    bin: Option<(&Binned, usize)>,
) -> Curve {
    let is_outside = |side: usize, i: usize| bin.is_some_and(|(all, at)| all[side][i] != at);
    let mut candidates = Vec::new();
    let mut boxes = Vec::new();
    for (index, detection) in frame.detections.iter().enumerate() {
        // The devkit checks the height before the class: a detection of any class that is too small may match a label.
        let small = difficulty.is_too_small(detection);
        if small || rule.claims(detection) {
            let devkits = (metric == Metric::Image).then_some(rule.iou_min);
            let share_max = [rule.dont_care_max, devkits].into_iter().flatten();
            let is_there = |max| in_dont_care(&frame.labels, &detection.image_box_px, max);
            let in_dont_care = share_max.reduce(f64::min).is_some_and(is_there);
            candidates.push(Candidate {
                score: score_of(detection),
                valid: !small,
                is_excused: in_dont_care || is_outside(1, index),
                near_truth: false,
            });
            boxes.push((detection.image_box_px, detection.camera_box.upright()));
        }
    }
    let mut truths = Vec::new();
    for (index, label) in frame.labels.iter().enumerate() {
        let Some(counts) = rule.label_counts(label) else {
            continue;
        };
        let upright = label.camera_box.upright();
        let overlap = |i: usize| match metric {
            Metric::Image => iou_2d(&boxes[i].0, &label.image_box_px),
            Metric::Bev => iou_bev(&boxes[i].1, &upright),
            Metric::Space => iou_3d(&boxes[i].1, &upright),
        };
        let near = (0..boxes.len()).map(|i| (i, overlap(i)));
        let near: Vec<_> = near.filter(|near| near.1 > rule.iou_min).collect();
        for (i, _) in &near {
            candidates[*i].near_truth = true;
        }
        truths.push(Truth {
            valid: counts && difficulty.takes(label) && !is_outside(0, index),
            near,
        });
    }
    let mut curve = Curve {
        truth_count: truths.iter().filter(|truth| truth.valid).count(),
        ..Curve::default()
    };
    match_by_score(&truths, &candidates, &mut curve);
    collect_steps(&truths, &candidates, &mut curve);
    curve
}

/// Whether more than a share of an image box lies in a region without labels.
pub(crate) fn in_dont_care(labels: &[Label], image_box_px: &[f64; 4], share_max: f64) -> bool {
    let mut regions = labels.iter().filter(|l| l.is_dont_care());
    regions.any(|r| overlap_of_first_2d(image_box_px, &r.image_box_px) > share_max)
}

/// The detection that each label takes, in file order: the best free detection with at least the score `score_min`.
fn take(
    truths: &[Truth],
    candidates: &[Candidate],
    score_min: f64,
    is_better: impl Fn(&(usize, f64), &(usize, f64)) -> bool,
) -> Vec<Option<usize>> {
    let mut taken = vec![false; candidates.len()];
    let mut one = |truth: &Truth| {
        let near = truth.near.iter();
        let free = near.filter(|(i, _)| !taken[*i] && candidates[*i].score >= score_min);
        let best = free.reduce(|best, near| if is_better(near, best) { near } else { best });
        let (best, _) = *best?;
        taken[best] = true;
        Some(best)
    };
    truths.iter().map(&mut one).collect()
}

/// First pass: no threshold, the highest score wins.
fn match_by_score(truths: &[Truth], candidates: &[Candidate], curve: &mut Curve) {
    let score = |near: &(usize, f64)| candidates[near.0].score;
    let better = |a: &_, b: &_| score(a) > score(b);
    let found = take(truths, candidates, f64::NEG_INFINITY, better);
    for (_, found) in truths.iter().zip(found).filter(|(truth, _)| truth.valid) {
        let found = found.map(|i| &candidates[i]).filter(|one| one.valid);
        curve.hit_scores.extend(found.map(|one| one.score));
    }
}

/// The frame's counts as a function of the threshold: a step at each score where they change.
fn collect_steps(truths: &[Truth], candidates: &[Candidate], curve: &mut Curve) {
    let mut order: Vec<usize> = (0..candidates.len()).collect();
    order.sort_by(|&a, &b| candidates[b].score.total_cmp(&candidates[a].score));
    let is_alarm = |c: &Candidate| c.valid && !c.is_excused;
    // Alarms that touch no label are counted apart from the others: only detections that overlap a label need another matching.
    let (mut lonely_alarms, mut hits, mut near_alarms) = (0, 0, 0);
    let (mut before, mut seen) = ((0, 0), 0);
    for group in order.chunk_by(|&a, &b| candidates[a].score == candidates[b].score) {
        seen += group.len();
        let score = candidates[group[0]].score;
        let of_group = || group.iter().map(|&i| &candidates[i]);
        lonely_alarms += of_group().filter(|c| !c.near_truth && is_alarm(c)).count() as i64;
        if of_group().any(|c| c.near_truth) {
            // Second pass: the greatest overlap wins; an ignored detection wins only where there is no valid one.
            let found = take(truths, candidates, score, |a, b| {
                candidates[a.0].valid && (!candidates[b.0].valid || a.1 > b.1)
            });
            let pairs = truths.iter().zip(&found);
            let is_hit = |(truth, i): &(&Truth, &Option<usize>)| {
                truth.valid && i.is_some_and(|i| candidates[i].valid)
            };
            hits = pairs.filter(is_hit).count() as i64;
            let is_open = |i: &&usize| {
                let c = &candidates[**i];
                c.near_truth && is_alarm(c) && !found.contains(&Some(**i))
            };
            near_alarms = order[..seen].iter().filter(is_open).count() as i64;
        }
        let now = (hits, near_alarms + lonely_alarms);
        if now != before {
            let (hits, alarms) = (now.0 - before.0, now.1 - before.1);
            curve.steps.push((score, hits, alarms));
        }
        before = now;
    }
}
