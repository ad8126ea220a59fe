//! Average precision on hand-made frames; the right answers follow from the devkit's rules and are computed on paper.

use super::{found, frame, label};
use crate::{AveragePrecision, ClassRule, Difficulty, LabelledFrame, Metric, UnknownProtocol};
use crate::{curve::Curve, matching::match_frame};
use mluc_dataset::Label;
use mluc_geometry::{Random, iou_3d};

const SPACE: Metric = Metric::Space;

/// An object ten metres from the one at the place before.
fn object(class: &str, place: usize) -> Label {
    label(class, 10.0 * place as f64)
}

/// The same detection with this height in the image.
fn with_height(mut detection: Label, height_px: f64) -> Label {
    detection.image_box_px[3] = detection.image_box_px[1] + height_px;
    detection
}

fn car(iou_min: f64) -> ClassRule {
    ClassRule::known("car", iou_min)
}

fn unknown(classes: &[&str], protocol: UnknownProtocol) -> ClassRule {
    let classes: Vec<String> = classes.iter().map(|class| (*class).to_owned()).collect();
    ClassRule::unknown(&classes, 0.1, protocol)
}

fn curve(frames: &[LabelledFrame], rule: &ClassRule, metric: Metric) -> Curve {
    let matched = |frame| match_frame(frame, rule, metric, Difficulty::Moderate, None);
    Curve::of(&frames.iter().map(matched).collect::<Vec<_>>())
}

/// AP of one frame over all points.
fn ap_all(labels: &[&Label], detections: &[Label], rule: &ClassRule) -> f64 {
    let labels = labels.iter().map(|label| (*label).clone()).collect();
    curve(&[frame(labels, detections.to_vec())], rule, SPACE).average_precision().all
}

/// AP of 41 hits and one false alarm with the highest score.
const ONE_FALSE: f64 = 100.0 * 41.0 / 42.0;

/// AP of 41 cars that are found; the first frame has an additional detection and perhaps an additional label.
fn ap_with(label: Option<&Label>, detection: Label, rule: &ClassRule, metric: Metric) -> f64 {
    let mut frames = perfect(41);
    frames[0].labels = frames[0].labels.iter().chain(label).cloned().collect();
    frames[0].detections.push(detection);
    let curve = curve(&frames, rule, metric);
    assert_eq!(curve.truth_count, 41);
    curve.average_precision().r40
}

fn close(found: f64, expected: f64) {
    assert!((found - expected).abs() < 0.01, "expected {expected}, found {found}");
}

/// `count` cars that are found, each in its own frame.
fn perfect(count: usize) -> Vec<LabelledFrame> {
    let one = |i: usize| {
        let label = object("Car", 0);
        let detection = found(&label, "car", 1.0 - i as f64 * 1e-3);
        frame(vec![label], vec![detection])
    };
    (0..count).map(one).collect()
}

#[test]
fn a_perfect_detector_is_capped_below_41_labels() {
    for (count, r11, r40) in [
        (1, 9.0909, 0.0),
        (5, 18.1818, 10.0),
        (10, 27.2727, 22.5),
        (20, 45.4545, 47.5),
        (40, 90.9091, 97.5),
        (41, 100.0, 100.0),
        (300, 100.0, 100.0),
    ] {
        let ap = curve(&perfect(count), &car(0.7), SPACE).average_precision();
        close(ap.r11, r11);
        close(ap.r40, r40);
        close(ap.all, 100.0);
    }
}

#[test]
fn one_hit_of_ten_labels() {
    let labels: Vec<Label> = (0..10).map(|i| object("Car", i)).collect();
    let detection = found(&labels[3], "Car", 0.9);
    let curve = curve(&[frame(labels, vec![detection])], &car(0.7), SPACE);
    let ap = curve.average_precision();
    close(ap.r11, 9.0909);
    close(ap.r40, 0.0);
    close(ap.all, 10.0);
    close(curve.recall_percent(), 10.0);
    assert_eq!(curve.truth_count, 10);
}

#[test]
fn nothing_labelled_or_nothing_found_is_zero() {
    let label = object("Car", 0);
    let detection = found(&label, "car", 0.5);
    // Sizes of -1000 in a region of tracking data must not make a box.
    let mut region = label.clone();
    region.camera_box.size_hwl_m = [-1000.0; 3];
    for frames in [
        vec![],
        vec![frame(vec![label], vec![])],
        vec![frame(vec![], vec![detection.clone()])],
        vec![frame(vec![region], vec![detection])],
    ] {
        let ap = curve(&frames, &car(0.7), SPACE).average_precision();
        assert_eq!(ap, AveragePrecision::default());
    }
}

/// Two of four cars are found, with one false alarm between them: recall 1/4 at precision 1, 1/2 at 2/3.
#[test]
fn the_area_under_a_small_curve() {
    let labels: Vec<Label> = (0..4).map(|i| object("Car", i)).collect();
    let nowhere = object("Car", 9);
    let detections = [(&labels[0], 0.9), (&nowhere, 0.8), (&labels[1], 0.7)];
    let detections = detections.map(|(label, score)| found(label, "car", score));
    let all = ap_all(&labels.iter().collect::<Vec<_>>(), &detections, &car(0.7));
    close(all, 25.0 + 25.0 * 2.0 / 3.0);
}

#[test]
fn labels_that_are_too_hard_absorb_detections() {
    for change in [
        (|l| l.occluded = 2) as fn(&mut Label),
        |l| l.truncated = 0.4,
        |l| l.image_box_px[3] = l.image_box_px[1] + 24.0,
    ] {
        let mut hidden = object("Car", 5);
        change(&mut hidden);
        let detection = with_height(found(&hidden, "car", 2.0), 50.0);
        close(ap_with(Some(&hidden), detection, &car(0.7), SPACE), 100.0);
    }
}

#[test]
fn dont_care_regions_forgive_in_the_image_only() {
    let mut region = object("DontCare", 7);
    let detection = found(&region, "car", 2.0);
    region.camera_box.size_hwl_m = [-1.0; 3];
    region.camera_box.location_m = [-1000.0; 3];
    let metrics = [Metric::Image, Metric::Bev, SPACE].into_iter();
    for (metric, expected) in metrics.zip([100.0, ONE_FALSE, ONE_FALSE]) {
        let ap = ap_with(Some(&region), detection.clone(), &car(0.7), metric);
        close(ap, expected);
    }
}

#[test]
fn the_height_of_a_detection_is_cut_to_whole_pixels() {
    for (height_px, expected) in [(25.9, ONE_FALSE), (25.0, ONE_FALSE), (24.99, 100.0)] {
        let detection = with_height(found(&object("Car", 8), "car", 2.0), height_px);
        close(ap_with(None, detection, &car(0.7), SPACE), expected);
    }
}

/// The devkit checks the height before the class, so a small pedestrian can take a car's label out of the count.
#[test]
fn a_small_detection_of_another_class_absorbs_a_label() {
    let mut frames = perfect(2);
    let small = found(&frames[0].labels[0], "pedestrian", 0.5);
    frames[0].detections = vec![with_height(small, 10.0)];
    let curve = curve(&frames, &car(0.7), SPACE);
    assert_eq!(curve.truth_count, 2);
    close(curve.average_precision().all, 50.0);
    close(curve.recall_percent(), 50.0);
}

/// With a low minimum overlap one detection may fit two labels: the first label in the file takes it.
#[test]
fn an_ignored_label_earlier_in_the_file_steals() {
    let valid = object("Car", 0);
    let mut hidden = valid.clone();
    hidden.occluded = 3;
    hidden.camera_box.location_m[0] += 0.5;
    let detection = [found(&valid, "car", 0.9)];
    assert_eq!(ap_all(&[&hidden, &valid], &detection, &car(0.1)), 0.0);
    assert_eq!(ap_all(&[&valid, &hidden], &detection, &car(0.1)), 100.0);
}

#[test]
fn an_overlap_equal_to_the_least_one_is_no_match() {
    let label = object("Car", 0);
    let mut detection = found(&label, "car", 0.9);
    // Half as high and inside the label: IoU is exactly 0.5.
    detection.camera_box.size_hwl_m[0] /= 2.0;
    for (iou_min, expected) in [(0.5, 0.0), (0.499, 100.0)] {
        let all = ap_all(&[&label], std::slice::from_ref(&detection), &car(iou_min));
        assert_eq!(all, expected);
    }
}

#[test]
fn unknown_classes_are_one_class() {
    let (van, truck, tram) = (object("Van", 0), object("Truck", 1), object("Tram", 2));
    let detections = vec![
        found(&van, "unknown", 0.9),
        found(&truck, "truck", 0.8),
        found(&tram, "unknown", 0.7),
        found(&object("Car", 4), "car", 0.95),
    ];
    let rule = unknown(&["van", "Truck"], UnknownProtocol::Literal);
    let curve = curve(&[frame(vec![van, truck, tram], detections)], &rule, SPACE);
    // The tram is background: its detection is a false alarm with a lower score than both hits.
    assert_eq!(curve.truth_count, 2);
    close(curve.average_precision().all, 100.0);
    close(curve.recall_percent(), 100.0);
}

/// A van is found last, after a tram, an object in a region without labels, one that lies partly there, and a wall.
#[test]
fn the_fair_protocol_counts_neither_trams_nor_what_lies_where_nobody_labelled() {
    let (van, tram, mut region) = (object("Van", 0), object("Tram", 1), object("DontCare", 2));
    region.camera_box.location_m = [-1000.0; 3];
    let mut half = object("", 3);
    half.image_box_px = region.image_box_px.map(|edge| edge + 25.0);
    let wall = object("", 4);
    let places = [&tram, &region, &half, &wall, &van].into_iter().zip([0.9, 0.8, 0.7, 0.6, 0.5]);
    let detections = places.map(|(label, score)| found(label, "unknown", score));
    let detections: Vec<Label> = detections.collect();
    for (protocol, false_before_the_van) in [
        (UnknownProtocol::Literal, 4.0),
        // Only a quarter of `half` lies in the region: it counts as a false alarm, and so does the wall.
        (UnknownProtocol::Fair, 2.0),
    ] {
        let rule = unknown(&["van"], protocol);
        let all = ap_all(&[&van, &tram, &region], &detections, &rule);
        close(all, 100.0 / (1.0 + false_before_the_van));
    }
}

#[test]
fn the_fair_protocol_ignores_three_classes_unless_they_are_unknown() {
    for class in ["Tram", "Misc", "Person_sitting"] {
        let (van, other) = (object("Van", 0), object(class, 1));
        let detections = [found(&other, "unknown", 0.9), found(&van, "unknown", 0.5)];
        for (rule, all) in [
            (unknown(&["van"], UnknownProtocol::Literal), 50.0),
            (unknown(&["van"], UnknownProtocol::Fair), 100.0),
            (unknown(&["van", class], UnknownProtocol::Fair), 100.0),
        ] {
            close(ap_all(&[&van, &other], &detections, &rule), all);
        }
    }
}

/// Three tenths of a detection lie in the region: the devkit ignores such a detection in the image, and nowhere else.
#[test]
fn the_fair_protocol_keeps_the_devkits_rule_in_the_image() {
    let (van, region) = (object("Van", 0), object("DontCare", 2));
    let mut part = found(&object("", 3), "unknown", 0.9);
    let [left, top, right, bottom] = region.image_box_px;
    part.image_box_px = [left + 35.0, top, right + 35.0, bottom];
    let detections = vec![part, found(&van, "unknown", 0.5)];
    let frames = [frame(vec![van, region], detections)];
    let rule = unknown(&["van"], UnknownProtocol::Fair);
    for (metric, all) in [(Metric::Image, 100.0), (SPACE, 50.0)] {
        close(curve(&frames, &rule, metric).average_precision().all, all);
    }
}

/// All thresholds at once must give the devkit's result for each threshold; this test matches from scratch for each one.
#[test]
fn every_threshold_agrees_with_matching_from_scratch() {
    let mut stream = Random::new(1, &[]);
    let mut random = || stream.unit();
    let mut frames = Vec::new();
    for _ in 0..30 {
        let classes = ["Car", "Car", "Car", "Van"].into_iter().enumerate();
        let mut labels: Vec<Label> = classes.map(|(i, class)| object(class, i)).collect();
        labels[1].occluded = if random() < 0.5 { 2 } else { 0 };
        let mut detections = Vec::new();
        for _ in 0..12 {
            let mut label = object("Car", (random() * 6.0) as usize);
            label.camera_box.location_m[0] += random() * 1.5;
            let score = (random() * 20.0).floor() / 20.0;
            let class = if random() < 0.9 { "car" } else { "cyclist" };
            let detection = found(&label, class, score);
            detections.push(with_height(detection, 50.0 - random() * 30.0));
        }
        frames.push(frame(labels, detections));
    }
    let rule = car(0.3);
    for step in 0..=20 {
        // Dropping the detections below a threshold leaves the curve above it unchanged.
        let threshold = f64::from(step) / 20.0;
        let mut cut = frames.clone();
        for frame in &mut cut {
            frame.detections.retain(|d| d.score >= Some(threshold));
        }
        let of = |frames: &[LabelledFrame]| curve(frames, &rule, SPACE).counts_at(threshold);
        assert_eq!(of(&frames), of(&cut), "threshold {threshold}");
        assert_eq!(of(&cut), plain_counts(&cut, &rule), "threshold {threshold}");
    }
}

/// Hits and false alarms of a list of frames, by a plain implementation of the devkit's rules.
fn plain_counts(frames: &[LabelledFrame], rule: &ClassRule) -> (i64, i64) {
    let (mut hits, mut false_alarms) = (0, 0);
    for frame in frames {
        let found = &frame.detections;
        let small = |i: usize| (found[i].image_box_px[3] - found[i].image_box_px[1]).trunc() < 25.0;
        let is_own = |i: usize| !small(i) && found[i].class == "car";
        let mut taken = vec![false; found.len()];
        for label in frame.labels.iter() {
            let valid = label.class == "Car" && label.occluded <= 1;
            let overlap =
                |i: usize| iou_3d(&found[i].camera_box.upright(), &label.camera_box.upright());
            let is_free = |i: &usize| !taken[*i] && overlap(*i) > rule.iou_min;
            let free: Vec<usize> = (0..taken.len()).filter(is_free).collect();
            let own = free.iter().copied().filter(|&i| is_own(i));
            let best = own.reduce(|a, b| if overlap(b) > overlap(a) { b } else { a });
            let absorbing = free.iter().copied().find(|&i| small(i));
            if let Some(i) = best.or(absorbing) {
                taken[i] = true;
                hits += i64::from(valid && best.is_some());
            }
        }
        let is_open = |i: &usize| !taken[*i] && is_own(*i);
        false_alarms += (0..taken.len()).filter(is_open).count() as i64;
    }
    (hits, false_alarms)
}
