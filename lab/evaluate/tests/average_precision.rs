//! Average precision on hand-made frames whose answer follows from the devkit's rules on paper.

use mluc_dataset::Label;
use mluc_evaluate::{
    AveragePrecision, CameraDetection, ClassRule, Curve, Difficulty, LabelledFrame, Metric,
    NeighbourPolicy, ObjectKind, UnknownProtocol, match_frames,
};
use mluc_geometry::{CameraBox, Random};

/// An object 50 px high that nothing hides, 10 m from its neighbours in space and in the image.
fn object(class: &str, place: usize) -> Label {
    let left = 60.0 * place as f64;
    Label {
        class: class.to_owned(),
        truncated: 0.0,
        occluded: 0,
        alpha_rad: 0.0,
        image_box_px: [left, 100.0, left + 50.0, 150.0],
        camera_box: CameraBox {
            location_m: [10.0 * place as f64, 1.7, 20.0],
            size_hwl_m: [1.5, 1.6, 4.0],
            rotation_y_rad: 0.3,
        },
        score: None,
    }
}

/// A detection just there.
fn found(label: &Label, class: &str, score: f64) -> CameraDetection {
    let (image_box_px, upright) = (label.image_box_px, label.camera_box.upright());
    let kind = if class == "unknown" {
        ObjectKind::Unknown
    } else {
        ObjectKind::Known
    };
    CameraDetection {
        kind,
        class: class.to_owned(),
        score,
        image_box_px,
        upright,
    }
}

fn frame(labels: Vec<Label>, detections: Vec<CameraDetection>) -> LabelledFrame {
    LabelledFrame {
        labels: labels.into(),
        detections,
    }
}

fn car() -> ClassRule {
    ClassRule::known("car", 0.7, NeighbourPolicy::Official)
}

fn curve(frames: &[LabelledFrame], rule: &ClassRule) -> Curve {
    match_frames(frames, rule, Metric::Space, Difficulty::Moderate)
}

fn ap_of(frames: &[LabelledFrame], rule: &ClassRule, metric: Metric) -> AveragePrecision {
    match_frames(frames, rule, metric, Difficulty::Moderate).average_precision()
}

fn ap(frames: &[LabelledFrame]) -> AveragePrecision {
    curve(frames, &car()).average_precision()
}

/// 41 cars that are found, and in the first frame one more label and detection.
fn perfect_and(label: Label, detection: CameraDetection) -> Vec<LabelledFrame> {
    let mut frames = perfect(41);
    frames[0].labels = vec![frames[0].labels[0].clone(), label].into();
    frames[0].detections.push(detection);
    frames
}

/// AP of 41 hits and one false alarm with the highest score.
const ONE_FALSE: f64 = 100.0 * 41.0 / 42.0;

fn close(found: f64, expected: f64) {
    assert!(
        (found - expected).abs() < 0.01,
        "expected {expected}, found {found}"
    );
}

/// `count` cars, each in a frame of its own and found.
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
        let ap = ap(&perfect(count));
        close(ap.r11, r11);
        close(ap.r40, r40);
        close(ap.all, 100.0);
    }
}

#[test]
fn one_hit_of_ten_labels() {
    let labels: Vec<Label> = (0..10).map(|i| object("Car", i)).collect();
    let detection = found(&labels[3], "Car", 0.9);
    let curve = curve(&[frame(labels, vec![detection])], &car());
    let ap = curve.average_precision();
    close(ap.r11, 9.0909);
    close(ap.r40, 0.0);
    close(ap.all, 10.0);
    close(curve.recall_percent(), 10.0);
    assert_eq!((curve.truth_count, curve.missed_count), (10, 9));
}

#[test]
fn nothing_labelled_or_nothing_found_is_zero() {
    let label = object("Car", 0);
    let detection = found(&label, "car", 0.5);
    for frames in [
        vec![],
        vec![frame(vec![label], vec![])],
        vec![frame(vec![], vec![detection])],
    ] {
        assert_eq!(ap(&frames), AveragePrecision::default());
    }
}

/// Two of four cars are found, with one false alarm between them: recall 1/4 at precision 1, 1/2 at 2/3.
#[test]
fn the_area_under_a_small_curve() {
    let labels: Vec<Label> = (0..4).map(|i| object("Car", i)).collect();
    let nowhere = object("Car", 9);
    let detections = vec![
        found(&labels[0], "car", 0.9),
        found(&nowhere, "car", 0.8),
        found(&labels[1], "car", 0.7),
    ];
    close(
        ap(&[frame(labels, detections)]).all,
        25.0 + 25.0 * 2.0 / 3.0,
    );
}

#[test]
fn a_duplicate_is_a_false_alarm() {
    let mut frames = perfect(50);
    let copy = frames[0].detections[0].clone();
    frames[0].detections.push(copy);
    // The copy has the highest score, so it costs at every threshold; the best precision is the last one's.
    close(ap(&frames).r40, 100.0 * 50.0 / 51.0);
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
        let mut detection = found(&hidden, "car", 2.0);
        detection.image_box_px[3] = detection.image_box_px[1] + 50.0;
        let frames = perfect_and(hidden, detection);
        close(ap(&frames).r40, 100.0);
        assert_eq!(curve(&frames, &car()).truth_count, 41);
    }
}

#[test]
fn a_van_found_as_a_car_is_neutral_or_strictly_wrong() {
    let van = object("Van", 3);
    let mistaken = found(&van, "car", 2.0);
    let frames = perfect_and(van, mistaken);
    close(ap(&frames).r40, 100.0);
    let strict = ClassRule::known("car", 0.7, NeighbourPolicy::Strict);
    close(ap_of(&frames, &strict, Metric::Space).r40, ONE_FALSE);
}

#[test]
fn dont_care_regions_forgive_in_the_image_only() {
    let mut region = object("DontCare", 7);
    let detection = found(&region, "car", 2.0);
    region.camera_box.size_hwl_m = [-1.0; 3];
    region.camera_box.location_m = [-1000.0; 3];
    let frames = perfect_and(region, detection);
    for (metric, expected) in [
        (Metric::Image, 100.0),
        (Metric::Bev, ONE_FALSE),
        (Metric::Space, ONE_FALSE),
    ] {
        close(ap_of(&frames, &car(), metric).r40, expected);
    }
}

/// Sizes of -1000 in a region of tracking data must not make a box.
#[test]
fn dont_care_boxes_of_negative_size_overlap_nothing() {
    let mut region = object("Car", 0);
    region.camera_box.size_hwl_m = [-1000.0; 3];
    let detection = found(&object("Car", 0), "car", 0.9);
    assert_eq!(ap(&[frame(vec![region], vec![detection])]).all, 0.0);
}

#[test]
fn the_height_of_a_detection_is_cut_to_whole_pixels() {
    for (height_px, expected) in [(25.9, ONE_FALSE), (25.0, ONE_FALSE), (24.99, 100.0)] {
        let mut frames = perfect(41);
        let mut detection = found(&object("Car", 8), "car", 2.0);
        detection.image_box_px[3] = detection.image_box_px[1] + height_px;
        frames[0].detections.push(detection);
        close(ap(&frames).r40, expected);
    }
}

/// The height is looked at before the class, so a small pedestrian can take a car's label out of the count.
#[test]
fn a_small_detection_of_another_class_absorbs_a_label() {
    let mut frames = perfect(2);
    let mut small = found(&frames[0].labels[0], "pedestrian", 0.5);
    small.image_box_px[3] = small.image_box_px[1] + 10.0;
    frames[0].detections = vec![small];
    let curve = curve(&frames, &car());
    assert_eq!((curve.truth_count, curve.missed_count), (2, 0));
    close(curve.average_precision().all, 50.0);
}

/// With a low overlap one detection may fit two labels: the first in the file takes it.
#[test]
fn an_ignored_label_earlier_in_the_file_steals() {
    let rule = ClassRule::known("car", 0.1, NeighbourPolicy::Official);
    let valid = object("Car", 0);
    let mut hidden = valid.clone();
    hidden.occluded = 3;
    hidden.camera_box.location_m[0] += 0.5;
    let detection = found(&valid, "car", 0.9);
    let stolen = frame(vec![hidden.clone(), valid.clone()], vec![detection.clone()]);
    let kept = frame(vec![valid, hidden], vec![detection]);
    assert_eq!(ap_of(&[stolen], &rule, Metric::Space).all, 0.0);
    assert_eq!(ap_of(&[kept], &rule, Metric::Space).all, 100.0);
}

#[test]
fn an_overlap_equal_to_the_least_one_is_no_match() {
    let label = object("Car", 0);
    let mut detection = found(&label, "car", 0.9);
    // Half as high and inside: IoU exactly 0.5.
    detection.upright.size_m[2] /= 2.0;
    detection.upright.center_m[2] -= detection.upright.size_m[2] / 2.0;
    let frames = [frame(vec![label], vec![detection])];
    for (iou_min, expected) in [(0.5, 0.0), (0.499, 100.0)] {
        let rule = ClassRule::known("car", iou_min, NeighbourPolicy::Official);
        assert_eq!(ap_of(&frames, &rule, Metric::Space).all, expected);
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
    let classes = ["van".to_owned(), "Truck".to_owned()];
    let rule = ClassRule::unknown(&classes, 0.1, UnknownProtocol::Literal);
    let curve = curve(&[frame(vec![van, truck, tram], detections)], &rule);
    // The tram is background: its detection is a false alarm, below both hits.
    assert_eq!((curve.truth_count, curve.missed_count), (2, 0));
    close(curve.average_precision().all, 100.0);
    close(curve.recall_percent(), 100.0);
}

/// A van is found last, after a tram, something where nobody labelled, half of something there, and a wall.
#[test]
fn the_fair_protocol_counts_neither_trams_nor_what_lies_where_nobody_labelled() {
    let (van, tram, mut region) = (object("Van", 0), object("Tram", 1), object("DontCare", 2));
    region.camera_box.location_m = [-1000.0; 3];
    let mut half = object("", 3);
    half.image_box_px = region.image_box_px.map(|edge| edge + 25.0);
    let detections = vec![
        found(&tram, "unknown", 0.9),
        found(&region, "unknown", 0.8),
        found(&half, "unknown", 0.7),
        found(&object("", 4), "unknown", 0.6),
        found(&van, "unknown", 0.5),
    ];
    let frames = [frame(vec![van, tram, region], detections)];
    for (protocol, false_before_the_van) in [
        (UnknownProtocol::Literal, 4.0),
        // A quarter of the half one lies in the region: it is wrong, and so is the wall.
        (UnknownProtocol::Fair, 2.0),
    ] {
        let rule = ClassRule::unknown(&["van".to_owned()], 0.1, protocol);
        let all = ap_of(&frames, &rule, Metric::Space).all;
        close(all, 100.0 / (1.0 + false_before_the_van));
    }
}

#[test]
fn the_fair_protocol_ignores_three_classes_unless_they_are_unknown_and_keeps_the_devkits_rule_in_the_image()
 {
    let rule = |unknown: &[&str], protocol| {
        let unknown: Vec<String> = unknown.iter().map(|class| (*class).to_owned()).collect();
        ClassRule::unknown(&unknown, 0.1, protocol)
    };
    for class in ["Tram", "Misc", "Person_sitting"] {
        let (van, other) = (object("Van", 0), object(class, 1));
        let detections = vec![found(&other, "unknown", 0.9), found(&van, "unknown", 0.5)];
        let frames = [frame(vec![van, other], detections)];
        for (rule, all) in [
            (rule(&["van"], UnknownProtocol::Literal), 50.0),
            (rule(&["van"], UnknownProtocol::Fair), 100.0),
            (rule(&["van", class], UnknownProtocol::Fair), 100.0),
        ] {
            close(ap_of(&frames, &rule, Metric::Space).all, all);
        }
    }
    // Three tenths of it lie in the region: the devkit forgives that in the image, and nowhere else.
    let (van, region) = (object("Van", 0), object("DontCare", 2));
    let mut part = found(&object("", 3), "unknown", 0.9);
    part.image_box_px = region.image_box_px;
    part.image_box_px[0] += 35.0;
    part.image_box_px[2] += 35.0;
    let detections = vec![part, found(&van, "unknown", 0.5)];
    let frames = [frame(vec![van, region], detections)];
    let rule = rule(&["van"], UnknownProtocol::Fair);
    close(ap_of(&frames, &rule, Metric::Image).all, 100.0);
    close(ap_of(&frames, &rule, Metric::Space).all, 50.0);
}

/// All thresholds at once must be what the devkit does one by one: matched again from scratch here.
#[test]
fn every_threshold_agrees_with_matching_from_scratch() {
    let mut stream = Random::new(1, &[]);
    let mut random = || stream.unit();
    let mut frames = Vec::new();
    for _ in 0..30 {
        let mut labels: Vec<Label> = (0..4)
            .map(|i| object(if i == 3 { "Van" } else { "Car" }, i))
            .collect();
        labels[1].occluded = if random() < 0.5 { 2 } else { 0 };
        let mut detections = Vec::new();
        for _ in 0..12 {
            let mut label = object("Car", (random() * 6.0) as usize);
            label.camera_box.location_m[0] += random() * 1.5;
            let score = (random() * 20.0).floor() / 20.0;
            let mut detection = found(
                &label,
                if random() < 0.9 { "car" } else { "cyclist" },
                score,
            );
            detection.image_box_px[3] -= random() * 30.0;
            detections.push(detection);
        }
        frames.push(frame(labels, detections));
    }
    let rule = ClassRule::known("car", 0.3, NeighbourPolicy::Official);
    for step in 0..=20 {
        // Dropping what lies below a threshold leaves the curve above it as it was.
        let threshold = f64::from(step) / 20.0;
        let mut cut = frames.clone();
        for frame in &mut cut {
            frame.detections.retain(|d| d.score >= threshold);
        }
        let of = |frames: &[LabelledFrame]| curve(frames, &rule).counts_at(threshold);
        assert_eq!(of(&frames), of(&cut), "threshold {threshold}");
        assert_eq!(of(&cut), plain_counts(&cut, &rule), "threshold {threshold}");
    }
}

/// Hits and false alarms of one frame list, written down plainly from the devkit's rules.
fn plain_counts(frames: &[LabelledFrame], rule: &ClassRule) -> (i64, i64) {
    let (mut hits, mut false_alarms) = (0, 0);
    for frame in frames {
        let small = |d: &CameraDetection| (d.image_box_px[3] - d.image_box_px[1]).trunc() < 25.0;
        let mut taken = vec![false; frame.detections.len()];
        for label in frame.labels.iter() {
            let valid = label.class == "Car" && label.occluded <= 1;
            let overlap = |i: usize| {
                mluc_geometry::iou_3d(&frame.detections[i].upright, &label.camera_box.upright())
            };
            let free: Vec<usize> = (0..taken.len())
                .filter(|&i| !taken[i] && overlap(i) > rule.iou_min)
                .collect();
            let own = free
                .iter()
                .copied()
                .filter(|&i| !small(&frame.detections[i]) && frame.detections[i].class == "car");
            let best = own.reduce(|a, b| if overlap(b) > overlap(a) { b } else { a });
            let absorbing = free.iter().copied().find(|&i| small(&frame.detections[i]));
            if let Some(i) = best.or(absorbing) {
                taken[i] = true;
                hits += i64::from(valid && best.is_some());
            }
        }
        let open = |i: &usize| {
            !taken[*i] && !small(&frame.detections[*i]) && frame.detections[*i].class == "car"
        };
        false_alarms += (0..taken.len()).filter(open).count() as i64;
    }
    (hits, false_alarms)
}
