//! Detection quality at a score: objects per scan, how many of them are on no label, and the share of labels found.
//!
//! An object is on a label when its centre is in the label's footprint, grown by 0.5 m on every side. An object counts when it is on a label, or within 70 m and
//! not in a region without labels; objects outside the image were dropped before. A label is found as for AP: overlap above its rule's minimum, moderate.
//!
//! Scans of a drive are correlated, so the intervals come from resampled drives, and in each from resampled runs of scans (block bootstrap). A score is chosen
//! by risk control: the upper 95 % bound of the false objects per scan, not their mean, stays below a limit. The reliability compares a score, or its
//! probability, with the share of objects on a label of their kind, by tenths. [`Operating::probabilities`] makes a model's table.

use crate::matching::{in_dont_care, match_frame};
use crate::{ClassRule, Difficulty, LabelledFrame, Metric, ObjectKind, UNKNOWN, curve::Curve};
use crate::{frame::range_m, frame::score_of, report::render};
use mluc_dataset::Label;
use mluc_geometry::{Inside, Random, quantile_of, resample};
use mluc_model::{Probabilities, RangeBand};
use rayon::prelude::*;
use serde_json::{Value, json};
use std::sync::Arc;

const RANGE_MAX_M: f64 = 70.0;
const MARGIN_M: f64 = 0.5;
/// An object is left out when more than this share of its image box lies in a region without labels.
pub(crate) const DONT_CARE_MAX: f64 = 0.5;
const DRAWS: usize = 1000;
/// Scans per run (block): a second at 10 Hz.
const BLOCK: usize = 10;
/// Objects per scan on no label for which the curve has a point.
const FALSE_A_SCAN: [f64; 9] = [5.0, 2.0, 1.0, 0.5, 0.3, 0.2, 0.1, 0.05, 0.0];
/// Lower ends of the range bands with their own probabilities, m.
const BANDS_M: [f64; 3] = [0.0, 20.0, 40.0];
/// Minimum number of objects, sorted by score, for one share.
const POOL: usize = 10;

/// Each figure: two entries of a frame's [`Counts`], the second dividing the first, and a factor. Figures per hour are at 10 Hz, recall is in percent.
const FIGURES: [(&str, usize, usize, f64); 6] = [
    ("objects", 1, 0, 1.0),
    ("on no label", 2, 0, 1.0),
    ("the same an hour", 2, 0, 36_000.0),
    ("on known", 3, 0, 1.0),
    ("on unknown", 4, 0, 1.0),
    ("recall", 5, 6, 100.0),
];

/// 1; objects; objects on no label, on known labels, on unknown labels; labels found; all labels.
type Counts = [f64; 7];

/// The label under an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Place {
    /// A label that counts for a rule of this kind.
    On(ObjectKind),
    /// A label that counts for no rule.
    Other,
    Nothing,
}

/// An evaluated object.
#[derive(Clone, Copy, Debug)]
struct Judged {
    kind: ObjectKind,
    score: f64,
    probability: Option<f64>,
    range_m: f64,
    place: Place,
}

impl Judged {
    fn is_right(&self) -> bool {
        self.place == Place::On(self.kind)
    }

    /// Its band of ranges.
    fn band(&self) -> Option<usize> {
        BANDS_M.iter().rposition(|from_m| *from_m <= self.range_m)
    }
}

#[derive(Clone, Debug)]
struct FrameOutcome {
    objects: Vec<Judged>,
    curves: Vec<(ObjectKind, Curve)>,
}

/// Evaluated scans of one or more drives.
#[derive(Clone, Debug)]
pub struct Operating {
    frames: Vec<FrameOutcome>,
    /// Frame indices of each resample.
    draws: Vec<Vec<usize>>,
}

/// Name, score, and each figure with its 95 % interval; `None` where there is nothing to count.
type Point = (String, f64, [Option<[f64; 3]>; 6]);

impl Operating {
    /// Evaluates frames in order of their drives; `drives` has the number of frames of each.
    pub fn of(frames: &[LabelledFrame], drives: &[usize], rules: &[ClassRule]) -> Operating {
        let judged = frames.par_iter().map(|frame| judge(frame, rules));
        Operating { frames: judged.collect(), draws: draws(drives) }
    }

    /// First the published objects, then the points at the lowest scores that leave at most the given numbers of objects per scan on no label. These
    /// scores were chosen on the evaluated scans: use them for a curve, not as scores for operation.
    fn points(&self, kind: ObjectKind) -> Vec<Point> {
        let scores = self.objects(kind).map(|o| o.score);
        let published = scores.reduce(f64::min).unwrap_or_default();
        let mut points = vec![self.point("published".to_owned(), kind, published)];
        let all: Vec<usize> = (0..self.frames.len()).collect();
        for most in FALSE_A_SCAN {
            let score_min = self.score_min(&all, kind, most);
            if points.last().is_some_and(|last| score_min > last.1) {
                points.push(self.point(format!("at most {most}"), kind, score_min));
            }
        }
        points
    }

    /// The lowest score at which the upper 95 % bound of the objects per scan on no label is at most `false_a_scan`.
    pub fn safe_score_min(&self, kind: ObjectKind, false_a_scan: f64) -> f32 {
        let of_draws = self.draws.iter().map(|draw| self.score_min(draw, kind, false_a_scan));
        // A model's scores are 0 to 1.
        quantile_of(of_draws.collect(), 0.95).map_or(0.0, |score| score.clamp(0.0, 1.0) as f32)
    }

    /// The lowest score at or above which at most `false_a_scan` objects per scan are on no label; negative infinity where every score satisfies this.
    fn score_min(&self, frames: &[usize], kind: ObjectKind, false_a_scan: f64) -> f64 {
        let objects = frames.iter().flat_map(|&at| &self.frames[at].objects);
        let wrong = objects.filter(|o| o.kind == kind && o.place == Place::Nothing);
        let mut scores: Vec<f64> = wrong.map(|o| o.score).collect();
        scores.sort_by(|a, b| b.total_cmp(a));
        // The small number absorbs rounding: 0.3 of 10 scans is 3.
        let most = (false_a_scan * frames.len() as f64 + 1e-9) as usize;
        // Scores are f32 values.
        let first_over = scores.get(most).map(|score| *score as f32);
        first_over.map_or(f64::NEG_INFINITY, |score| score.next_up().into())
    }

    fn point(&self, name: String, kind: ObjectKind, score_min: f64) -> Point {
        let frames = self.frames.iter();
        let counts: Vec<Counts> = frames.map(|frame| frame.counts(kind, score_min)).collect();
        let sums = |draw: &[usize]| {
            draw.iter().fold([0.0; 7], |mut sums, &at| {
                sums.iter_mut().zip(counts[at]).for_each(|(sum, count)| *sum += count);
                sums
            })
        };
        let all = sums(&(0..counts.len()).collect::<Vec<_>>());
        let drawn: Vec<Counts> = self.draws.iter().map(|draw| sums(draw)).collect();
        let figures = FIGURES.map(|(_, part, whole, factor)| {
            let of = |sums: &Counts| (sums[whole] > 0.0).then(|| factor * sums[part] / sums[whole]);
            let drawn: Vec<f64> = drawn.iter().filter_map(of).collect();
            let [low, high] = [0.025, 0.975].map(|q| quantile_of(drawn.clone(), q));
            Some([of(&all)?, low?, high?])
        });
        (name, score_min, figures)
    }

    fn objects(&self, kind: ObjectKind) -> impl Iterator<Item = &Judged> {
        let objects = self.frames.iter().flat_map(|frame| &frame.objects);
        objects.filter(move |object| object.kind == kind)
    }

    /// Table from scores to probabilities: in each range band the share of objects on a label of their kind, made monotonic in the score (objects
    /// in score order are pooled until it is). No table for a kind without any right object: such objects were not labelled.
    pub fn probabilities(&self) -> Probabilities {
        let bands = |kind| {
            let band = |at| {
                let own = self.objects(kind).filter(|o| o.band() == Some(at));
                RangeBand {
                    range_min_m: BANDS_M[at] as f32,
                    steps: rising(own.map(|o| (o.score, o.is_right())).collect()),
                }
            };
            let is_labelled = self.objects(kind).any(Judged::is_right);
            let bands = (0..BANDS_M.len()).filter(|_| is_labelled).map(band);
            bands.filter(|band| !band.steps.is_empty()).collect()
        };
        Probabilities { known: bands(ObjectKind::Known), unknown: bands(ObjectKind::Unknown) }
    }

    /// The calibration errors of scores of at least `score_min`, and of their probabilities from a table; `None` without objects.
    pub fn calibration_errors(
        &self,
        kind: ObjectKind,
        score_min: f32,
        table: &Probabilities,
    ) -> [Option<f64>; 2] {
        let score = |o: &Judged| Some(o.score).filter(|score| *score >= score_min.into());
        let told = |o: &Judged| {
            let is_known = kind == ObjectKind::Known;
            table.of(is_known, o.range_m as f32, score(o)? as f32).map(f64::from)
        };
        let scores = self.reliability(kind, score);
        [scores, self.reliability(kind, told)].map(|of| of["calibration_error"].as_f64())
    }

    /// By tenth of a value: objects, their mean value, and the share on a label of their kind; then the calibration error
    /// (the mean difference of the two, weighted by objects per tenth; Guo 2017, eq. 3). Values above 1 are in the last tenth.
    fn reliability(&self, kind: ObjectKind, value: impl Fn(&Judged) -> Option<f64>) -> Value {
        let mut tenths = [[0.0; 3]; 10];
        let told = self.objects(kind).filter_map(|o| Some((o, value(o)?)));
        for (object, value) in told {
            let tenth = &mut tenths[((10.0 * value) as usize).min(9)];
            let found = [1.0, value, f64::from(u8::from(object.is_right()))];
            tenth.iter_mut().zip(found).for_each(|(sum, one)| *sum += one);
        }
        let count: f64 = tenths.iter().map(|tenth| tenth[0]).sum();
        let gaps = tenths.iter().map(|[_, value, hits]| (value - hits).abs());
        let error = (count > 0.0).then(|| gaps.sum::<f64>() / count);
        let rows = tenths.iter().enumerate().filter(|(_, tenth)| tenth[0] > 0.0);
        let rows = rows.map(|(at, [objects, value, hits])| {
            let from = at as f64 / 10.0;
            json!({"from": from, "objects": objects, "mean": value / objects, "on_own_label": hits / objects})
        });
        json!({"tenths": rows.collect::<Value>(), "calibration_error": error})
    }

    /// `{"unknown": [{"name": "published", "score_min": .., "objects": [value, low, high], ..}, ..], "known": .., "reliability": ..}`.
    pub fn to_json(&self) -> Value {
        let point = |(name, score_min, figures): &Point| {
            let mut object = json!({"name": name, "score_min": score_min});
            for ((name, ..), figure) in FIGURES.iter().zip(figures) {
                object[name.replace(' ', "_")] = json!(figure);
            }
            object
        };
        let all = |kind| self.points(kind).iter().map(point).collect::<Value>();
        let [unknown, known] = [ObjectKind::Unknown, ObjectKind::Known];
        let reliability = [(unknown, "unknown"), (known, "known")].map(|(kind, name)| {
            let of = |value: String, told: &dyn Fn(&Judged) -> Option<f64>| {
                let of = self.reliability(kind, told);
                json!({"kind": name, "value": value, "tenths": of["tenths"], "calibration_error": of["calibration_error"]})
            };
            let score = of("score".into(), &|o| Some(o.score));
            let all = [score, of("probability".into(), &|o| o.probability)];
            let bands = BANDS_M.iter().enumerate().map(|(at, from_m)| {
                let told = |o: &Judged| o.probability.filter(|_| o.band() == Some(at));
                of(format!("probability, {from_m} m on"), &told)
            });
            all.into_iter().chain(bands).collect::<Vec<_>>()
        });
        let told = reliability.into_iter().flatten();
        let reliability: Value = told.filter(|of| of["calibration_error"].is_f64()).collect();
        json!({"scans": self.frames.len(), "unknown": all(unknown), "known": all(known), "reliability": reliability})
    }

    /// The same as a text table.
    pub fn to_table(&self) -> String {
        let mut values = self.to_json();
        values["figures"] = json!(FIGURES.map(|(name, ..)| name));
        render(include_str!("operating.txt"), values)
    }
}

impl FrameOutcome {
    fn counts(&self, kind: ObjectKind, score_min: f64) -> Counts {
        let objects = self.objects.iter().filter(|o| o.kind == kind && o.score >= score_min);
        let on = |place| objects.clone().filter(|o| o.place == place).count() as f64;
        let curves = self.curves.iter().filter(|(of, _)| *of == kind);
        let curve = Curve::of(curves.map(|(_, curve)| curve));
        let (hits, labels) = (curve.counts_at(score_min).0, curve.truth_count);
        let kinds = [ObjectKind::Known, ObjectKind::Unknown];
        let [known, unknown] = kinds.map(|kind| on(Place::On(kind)));
        let none = on(Place::Nothing);
        let all = objects.count() as f64;
        [1.0, all, none, known, unknown, hits as f64, labels as f64]
    }
}

/// Frames of each resample: as many drives as there are, with repeats, and in each drive as many scans as it has, in runs.
fn draws(drives: &[usize]) -> Vec<Vec<usize>> {
    let draw = |number: usize| {
        let mut random = Random::new(1, &[number as u64]);
        let own = |drive: usize| {
            let (first, count) = (drives[..drive].iter().sum::<usize>(), drives[drive]);
            let own = resample(count, BLOCK.min(count.div_ceil(2)), &mut random);
            own.into_iter().map(move |at| first + at)
        };
        let drawn = resample(drives.len(), 1, &mut Random::new(2, &[number as u64]));
        drawn.into_iter().flat_map(own).collect()
    };
    (0..DRAWS).map(draw).collect()
}

/// The part of a frame that is counted; an object on a counted label stays in also beyond the maximum range or in a region without labels.
pub(crate) fn counted(frame: &LabelledFrame) -> LabelledFrame {
    let is_near = |label: &&Label| range_m(&label.camera_box.upright()) <= RANGE_MAX_M;
    let is_labelled = |d: &&Label| !in_dont_care(&frame.labels, &d.image_box_px, DONT_CARE_MAX);
    let labels: Arc<[Label]> = frame.labels.iter().filter(is_near).cloned().collect();
    let is_found = |d: &&Label| labels.iter().any(|label| is_on(d, label));
    let counts = |d: &&Label| is_found(d) || is_near(d) && is_labelled(d);
    let detections = frame.detections.iter().filter(counts).cloned().collect();
    LabelledFrame { labels, detections }
}

fn judge(frame: &LabelledFrame, rules: &[ClassRule]) -> FrameOutcome {
    let near = counted(frame);
    let match_one = |rule: &ClassRule| {
        let curve = match_frame(&near, rule, Metric::Space, Difficulty::Moderate, None);
        (rule.kind, curve)
    };
    let kind_of = |detection: &Label| {
        let mut unknown = rules.iter().filter(|rule| rule.kind == ObjectKind::Unknown);
        if detection.is(UNKNOWN) || unknown.any(|rule| rule.claims(detection)) {
            ObjectKind::Unknown
        } else {
            ObjectKind::Known
        }
    };
    let object = |detection: &Label| {
        let kind = kind_of(detection);
        Judged {
            kind,
            score: score_of(detection),
            probability: detection.probability,
            range_m: range_m(&detection.camera_box.upright()),
            place: lies_on(detection, kind, frame, rules),
        }
    };
    FrameOutcome {
        objects: near.detections.iter().map(object).collect(),
        curves: rules.iter().map(match_one).collect(),
    }
}

/// Scores with the share of right objects, both ascending: neighbours with a falling share are pooled. A share is computed with half a right
/// and half a wrong object more, so that it is never 0 or 1.
fn rising(mut objects: Vec<(f64, bool)>) -> Vec<[f32; 2]> {
    // At equal scores the right ones come first: the share falls, so the objects are pooled.
    objects.sort_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
    let share = |[count, _, right]: &[f64; 3]| right / count;
    let mut pools: Vec<[f64; 3]> = vec![];
    // The chunk with fewer objects has the lowest scores.
    for pool in objects.rchunks(POOL).rev() {
        let right = pool.iter().filter(|object| object.1).count() as f64;
        let scores = pool.iter().map(|object| object.0).sum();
        pools.push([pool.len() as f64, scores, right]);
        while let [.., before, last] = &mut pools[..]
            && share(before) >= share(last)
        {
            *before = [0, 1, 2].map(|at| before[at] + last[at]);
            pools.pop();
        }
    }
    let mut most = 1.0f64;
    let step = |[count, scores, right]: &[f64; 3]| {
        most = most.min((right + 0.5) / (count + 1.0));
        [(scores / count) as f32, most as f32]
    };
    let mut steps: Vec<_> = pools.iter().rev().map(step).collect();
    steps.reverse();
    steps
}

/// With several labels under the object, a label of its own kind wins.
pub(crate) fn lies_on(
    detection: &Label,
    own: ObjectKind,
    frame: &LabelledFrame,
    rules: &[ClassRule],
) -> Place {
    let around = frame.labels.iter().filter(|label| is_on(detection, label));
    let places = around.map(|label| {
        let rule = rules.iter().find(|rule| rule.label_counts(label) == Some(true));
        rule.map_or(Place::Other, |rule| Place::On(rule.kind))
    });
    let rank = |place: &Place| (*place != Place::On(own), *place == Place::Other);
    places.min_by_key(rank).unwrap_or(Place::Nothing)
}

pub(crate) fn is_on(detection: &Label, label: &Label) -> bool {
    let [x, y, _] = detection.camera_box.upright().center_m;
    let shape = label.camera_box.upright();
    !label.is_dont_care() && Inside::of(&shape, MARGIN_M).contains([x, y, shape.center_m[2]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::UnknownProtocol;
    use crate::tests::{found, found_at, frame, label};

    fn rules() -> [ClassRule; 2] {
        let unknown = ["van".to_owned(), "truck".to_owned()];
        [ClassRule::known("car", 0.5), ClassRule::unknown(&unknown, 0.1, UnknownProtocol::Literal)]
    }

    /// Name, and all figures except the one per hour.
    fn figures(point: &Point) -> (&str, Vec<f64>) {
        let figures = point.2.iter().flatten().map(|[value, low, high]| {
            assert!(low <= value && value <= high, "{point:?}");
            *value
        });
        let mut figures: Vec<f64> = figures.collect();
        figures.remove(2);
        (&point.0, figures)
    }

    #[test]
    fn objects_are_counted_by_what_they_lie_on() {
        let ahead = |metres: f64, score| {
            let mut object = found_at(10.0, UNKNOWN, score);
            let [x, _, z] = &mut object.camera_box.location_m;
            (*x, *z) = (*x + metres * 0.3f64.cos(), *z - metres * 0.3f64.sin());
            object
        };
        let labels = ["Van", "Truck", "Car", "Misc"].into_iter().zip(1..);
        let labels = labels.map(|(class, place)| label(class, 10.0 * f64::from(place)));
        let mut labels: Vec<Label> = labels.collect();
        labels.push(label("DontCare", 500.0));
        labels[4].camera_box.location_m = [-1000.0; 3];
        let mut objects = vec![
            // A label is 4 m long.
            ahead(2.4, 0.8),
            ahead(2.6, 0.6),
            found_at(30.0, UNKNOWN, 0.5),
            found_at(40.0, UNKNOWN, 0.4),
            found_at(30.0, "car", 0.9),
            // One is in the region without labels, one beyond 70 m.
            found_at(500.0, UNKNOWN, 0.9),
            found_at(0.0, UNKNOWN, 0.9),
        ];
        objects[5].camera_box.location_m[0] = 0.0;
        objects[6].camera_box.location_m[2] = 71.0;
        let mut frames = [frame(labels, objects), frame(vec![], vec![])];
        let judged = Operating::of(&frames, &[1, 1], &rules());
        let points = judged.points(ObjectKind::Unknown);
        let published = ("published", vec![2.0, 0.5, 0.5, 0.5, 50.0]);
        assert_eq!(figures(&points[0]), published);
        let last = points.last().expect("a curve");
        let expected = ("at most 0.3", vec![0.5, 0.0, 0.0, 0.5, 50.0]);
        assert_eq!(figures(last), expected);
        assert!(last.1 > 0.6 && last.1 < 0.6001);
        let known = judged.points(ObjectKind::Known);
        assert_eq!(known.len(), 1);
        assert_eq!(figures(&known[0]).1, [0.5, 0.0, 0.5, 0.0, 100.0]);
        // The object with score 0.8 is on a van; the objects with 0.6, 0.5 and 0.4 are on no unknown label.
        let reliability = judged.reliability(ObjectKind::Unknown, |o| Some(o.score));
        let error = reliability["calibration_error"].as_f64().expect("objects");
        assert!((error - (0.2 + 0.6 + 0.5 + 0.4) / 4.0).abs() < 1e-6);
        let tenth = json!({"from": 0.8, "objects": 1.0, "mean": 0.8, "on_own_label": 1.0});
        assert_eq!(reliability["tenths"][3], tenth);
        assert!(judged.to_table().contains("calibration error 0.425"));
        // Scores may lie below 0.
        for object in &mut frames[0].detections {
            object.score = object.score.map(|score| score - 1.0);
        }
        let low = Operating::of(&frames, &[1, 1], &rules()).points(ObjectKind::Unknown);
        assert!(low.iter().map(figures).eq(points.iter().map(figures)));
    }

    #[test]
    fn what_a_score_is_worth_is_the_share_that_was_right_and_rises() {
        // All objects with a score above 0.5 are right, and every fourth of the others; beyond 40 m none.
        let scan = |i: usize| {
            let score = i as f64 / 200.0;
            let far = found_at(-40.0, UNKNOWN, score);
            let labels = (score > 0.5 || i.is_multiple_of(4)).then(|| label("Van", 0.0));
            let objects = vec![found_at(0.0, UNKNOWN, score), far];
            frame(labels.into_iter().collect(), objects)
        };
        let frames: Vec<LabelledFrame> = (0..200).map(scan).collect();
        let judged = Operating::of(&frames, &[200], &rules());
        let table = judged.probabilities();
        assert_eq!((table.known.len(), table.unknown.len()), (0, 2));
        let mut steps = table.unknown.iter().flat_map(|band| band.steps.windows(2));
        assert!(steps.all(|pair| pair[0][1] <= pair[1][1]), "{table:?}");
        let told = |range_m, score| table.of(false, range_m, score).expect("a table");
        assert!((told(20.0, 0.2) - 0.25).abs() < 0.05 && told(39.9, 0.9) > 0.95);
        assert!(told(50.0, 0.9) < 0.01);
        let [score, probability] = judged.calibration_errors(ObjectKind::Unknown, 0.0, &table);
        assert!(score > Some(0.2) && probability < Some(0.05), "{score:?} {probability:?}");
        let known = judged.calibration_errors(ObjectKind::Known, 0.0, &table);
        assert_eq!(known, [None; 2]);
        let of_one_score = [false, true].map(|is_right| [(0.9, is_right); POOL]);
        assert_eq!(rising(of_one_score.concat()), [[0.9f32, 0.5]]);
    }

    #[test]
    fn a_chosen_score_is_above_the_one_that_leaves_as_many_on_these_scans() {
        let scan = |i: usize| {
            let score = Random::new(7, &[i as u64]).unit() as f32;
            frame(vec![], vec![found(&label("", 0.0), UNKNOWN, score.into())])
        };
        let frames: Vec<LabelledFrame> = (0..100).map(scan).collect();
        let judged = Operating::of(&frames, &[100], &rules());
        let all: Vec<usize> = (0..100).collect();
        let plain = judged.score_min(&all, ObjectKind::Unknown, 0.3);
        let above = judged.frames.iter().filter(|f| f.objects[0].score >= plain);
        assert_eq!(above.count(), 30);
        let safe = f64::from(judged.safe_score_min(ObjectKind::Unknown, 0.3));
        assert!(safe > plain && safe < plain + 0.2, "{plain} {safe}");
        assert_eq!(judged.safe_score_min(ObjectKind::Unknown, 1.0), 0.0);
        assert_eq!(judged.safe_score_min(ObjectKind::Known, 0.0), 0.0);
    }
}
