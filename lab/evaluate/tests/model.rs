//! Judges a model on simulated scans: the path from points to figures, the closed set, the choice of the threshold.

use mluc_backbone::Precision;
use mluc_dataset::{Dataset, Label};
use mluc_evaluate::pipeline::{
    DetectedFrame, FrameSet, ModelGate, ModelJudgement, ScoreSeparation, choose_profiles,
    choose_threshold, detect_frames, judge, objects_at, sweep_gate, unknown_classes,
    write_profiles, write_threshold,
};
use mluc_evaluate::{ObjectKind, SensorDetection, SweepPoint, best_index};
use mluc_geometry::Box3;
use mluc_head::Detection;
use mluc_model::{Model, ScoreMin, model_bytes};
use mluc_refiner::{Settings, Variant};
use mluc_simulate::{ExportOptions, Family, Split, export};
use mluc_tests::untrained_udi;
use std::path::PathBuf;

/// Boxes on the labels like those of a trained network: known objects near their prototypes, unknown objects (called cars)
/// between them; in each frame one known object is as uncertain as the unknown ones.
fn synthetic_unknown(set: &FrameSet, dataset: &Dataset, classes: &[String]) -> Vec<DetectedFrame> {
    let frame = |index: usize| {
        let name = &set.names()[index];
        let labels = dataset.boxes_in_sensor(name).expect("labels");
        let kept = labels.iter().enumerate().map(|(i, (label, shape))| {
            let class = classes.iter().position(|c| label.is(c));
            let noise = ((index * 31 + i) * 7919 % 100) as f32 / 1000.0;
            let e = match class {
                Some(_) if i % 9 == 0 => 1.3 + noise,
                Some(_) => 1.8 + noise,
                None => 1.1 + noise,
            };
            detection(shape, class.unwrap_or(0), 0.9 - noise, e)
        });
        DetectedFrame { truth: set.truth(index).expect("labels"), detections: kept.collect() }
    };
    (0..set.names().len()).map(frame).collect()
}

fn detection(shape: &Box3, class: usize, score: f32, e: f32) -> Detection {
    Detection {
        center_m: shape.center_m.map(|v| v as f32),
        size_m: shape.size_m.map(|v| v as f32),
        yaw_rad: shape.yaw_rad as f32,
        class_id: class as u32,
        probabilities: [0.25; 8],
        objectness: score,
        score,
        eds: 48.0 * e,
        eds_normalised: e,
        eds_perpendicular: e,
        ..Detection::default()
    }
}

#[test]
fn boxes_that_touch_no_label_are_the_background() {
    let mut fixture = Fixture::new(12);
    let of_e = |fixture: &Fixture| fixture.judge(&fixture.model).separation[0].clone();
    let before = of_e(&fixture);
    assert_eq!((before.background, before.auroc_background), (0, None));
    // One box between the prototypes and three far beyond them, high above the ground. Before them: a box on a label that has a surer box.
    for frame in &mut fixture.frames {
        let worse = frame.detections.first().map(|surer| Detection {
            objectness: 0.1,
            eds_normalised: 1.0,
            ..*surer
        });
        let above = Box3::new([20.0, 0.0, 40.0, 2.0, 1.0, 1.5, 0.0]);
        let boxes = [1.0, 3.0, 3.0, 3.0].map(|e| detection(&above, 0, 0.2, e));
        frame.detections.extend(boxes.into_iter().chain(worse));
        frame.detections.rotate_right(1);
    }
    let e = of_e(&fixture);
    assert_eq!((e.background, e.auroc_background), (48, Some(0.75)));
    let figures = |s: &ScoreSeparation| (s.auroc, s.known, s.unknown);
    assert_eq!(figures(&e), figures(&before));
    // In a region without labels a box may lie on any object.
    let region = Label {
        class: "DontCare".to_owned(),
        image_box_px: [0.0, 0.0, 1e4, 1e4],
        ..Label::default()
    };
    for frame in &mut fixture.frames {
        let labels = frame.truth.labels.iter().chain([&region]);
        frame.truth.labels = labels.cloned().collect();
    }
    let e = of_e(&fixture);
    assert_eq!((e.background, figures(&e)), (0, figures(&before)));
}

#[test]
fn without_the_gate_the_objects_are_the_detections() {
    let fixture = Fixture::new(2);
    let (model, set) = (&fixture.model, &fixture.set);
    let frames = detect_frames(Precision::default(), model, set, || ()).expect("detections");
    let (gate, settings) = (ModelGate::of(model), Settings::default());
    // If all scores are below the threshold, no object stays known.
    let asked = vec![0.0, f64::from(f32::MAX)];
    let found = objects_at(model, gate, set, &frames, &settings, asked, &|| ()).expect("objects");
    let classes = model.manifest.class_names();
    for (index, frame) in frames.iter().enumerate() {
        let pair: &[_; 2] = found.objects[index][..].try_into().expect("two thresholds");
        let [objects, gated] = pair;
        let count = frame.detections.len();
        assert!(count > 10 && objects.len() == count, "{count} boxes");
        for (object, detection) in objects.iter().zip(&frame.detections) {
            assert_eq!(*object, SensorDetection::of_box(detection, &classes));
        }
        assert!(gated.iter().all(|o| o.kind == ObjectKind::Unknown));
    }
}

/// Scans, an untrained model, and boxes like those of a trained network.
struct Fixture {
    folder: tempfile::TempDir,
    path: PathBuf,
    model: Model,
    set: FrameSet,
    frames: Vec<DetectedFrame>,
}

impl Fixture {
    fn new(scan_count: u32) -> Fixture {
        let folder = tempfile::tempdir().expect("a folder");
        // Validation scenes also contain unknown objects.
        let root = folder.path().join("val");
        let options = ExportOptions::new(Family::SimUdi, Split::Val, scan_count, 3, root.clone());
        export(&options, || ()).expect("simulated scans");
        let path = folder.path().join("model.safetensors");
        std::fs::write(&path, untrained_udi()).expect("written");
        let model = Model::read(&path).expect("a model");
        let set = FrameSet::open(&root, Some("val"), usize::MAX).expect("frames");
        let dataset = Dataset::open(&root).expect("scans");
        let frames = synthetic_unknown(&set, &dataset, &model.manifest.class_names());
        Fixture { folder, path, model, set, frames }
    }

    fn judge(&self, model: &Model) -> ModelJudgement {
        let (unknown, settings) = (unknown_classes("udi"), Settings::default());
        judge(model, &self.set, &self.frames, &unknown, &settings).expect("judged")
    }

    fn sweep(&self, judged: &ModelJudgement) -> Vec<SweepPoint> {
        let (settings, rules) = (Settings::default(), &judged.rules);
        let (model, set, frames) = (&self.model, &self.set, &self.frames);
        sweep_gate(model, set, frames, rules, &settings, &|| ()).expect("figures")
    }
}

#[test]
fn the_sweep_begins_with_the_closed_set_and_finds_the_gap() {
    let fixture = Fixture::new(12);
    let judged = fixture.judge(&fixture.model);
    let swept = fixture.sweep(&judged);

    let closed = judged.closed.map_known().r40;
    assert!(closed > 30.0, "{closed:?}");
    let first = swept[0];
    assert_eq!(first.threshold, 0.0);
    assert_eq!(first.map_known.to_bits(), closed.to_bits());
    assert_eq!((first.recall_unknown, first.ap_unknown), (0.0, 0.0));
    assert!(swept.len() > 30);

    // Every unknown object is below 1.2, the certain known objects are above 1.8.
    assert!(judged.unknown_labels() > 0);
    assert_eq!(judged.unknown_as_known, judged.unknown_labels());
    let e = &judged.separation[0];
    assert!(e.auroc > Some(0.99) && e.known > 40 && e.unknown > 0, "{e:?}");
    let best = swept[best_index(&swept)];
    assert!((1.1..=1.81).contains(&best.threshold), "{best:?}");
    assert!(best.recall_unknown > 30.0, "{best:?}");
    assert!(best.map_known >= 0.9 * closed);

    let path = &fixture.path;
    let mut model = fixture.model.clone();
    model.manifest.provenance.metrics.insert("map_known_int8".to_owned(), 1.0);
    std::fs::write(path, model_bytes(&model.manifest, &model.weights).expect("bytes")).unwrap();
    let model = &Model::read(path).expect("a model");
    let (gate, data) = (ModelGate::of(model), fixture.set.describe());
    let choice = choose_threshold(gate, &swept, &judged, &data, "paper-corrected");
    write_threshold(path, model, &choice).expect("written");
    let written = Model::read(path).expect("a model");
    assert_eq!(written.weights, model.weights);
    let threshold = written.manifest.thresholds.eds_normalised_max;
    assert_eq!(f64::from(threshold), best.threshold);
    let provenance = &written.manifest.provenance;
    let reason = &provenance.threshold_choice;
    assert!(reason.contains("val, split val, 12 frames"), "{reason}");
    assert_eq!(provenance.metrics["ap_unknown"], best.ap_unknown);
    assert!(!provenance.metrics.contains_key("map_known_int8"), "of another threshold");
    assert_eq!(provenance.metrics["map_known_closed"], closed);
    let files = std::fs::read_dir(fixture.folder.path()).expect("a folder");
    assert_eq!(files.count(), 2);

    // At its new threshold the model's own figures equal those of the sweep.
    let again = fixture.judge(&written);
    let unknown = again.gated.unknown().expect("an unknown group").main();
    let known = again.gated.map_known();
    assert_eq!(known.r40.to_bits(), best.map_known.to_bits());
    assert_eq!(unknown.ap.r40.to_bits(), best.ap_unknown.to_bits());

    // The file is no longer the file that was judged.
    let fault = write_threshold(path, model, &choice).expect_err("changed");
    let expected = "expected the file that was judged";
    assert!(fault.to_string().contains(expected), "{fault}");
}

#[test]
fn scores_of_profiles_keep_false_objects_below_their_limits() {
    let mut fixture = Fixture::new(12);
    // Each frame gets a known and an unknown object that are on no label: more than any profile allows.
    for frame in &mut fixture.frames {
        for (y_m, e) in [(65.0, 3.0), (-65.0, 1.1)] {
            let aside = Box3::new([0.0, y_m, 0.0, 4.0, 1.6, 1.5, 0.0]);
            frame.detections.push(detection(&aside, 0, 0.25, e));
        }
    }
    let (model, set, path) = (&fixture.model, &fixture.set, &fixture.path);
    let rules = fixture.judge(model).rules;
    let mut gated = model.clone();
    gated.manifest.thresholds.eds_normalised_max = 1.2;
    // Without a refiner unknown objects are ranked by 1 / EDS.
    let settings = Settings::of(Variant::None);
    let chosen = choose_profiles(&gated, set, &fixture.frames, &rules, &settings).expect("scores");
    for (_, least) in chosen.profiles.named() {
        let expected = ScoreMin {
            known: 0.25f32.next_up(),
            unknown: (1.0f32 / (48.0 * 1.1)).next_up(),
            both_readings: false,
        };
        assert_eq!(least, expected);
    }
    write_profiles(path, model, &chosen, "twelve scans").expect("written");
    let written = Model::read(path).expect("a model").manifest;
    assert_eq!(written.thresholds.profiles, Some(chosen.profiles));
    let expected = Some(chosen.probabilities.clone());
    assert_eq!(written.thresholds.probabilities, expected);
    let reason = &written.provenance.profile_choice;
    assert!(reason.ends_with("data: twelve scans"), "{reason}");
    let fault = write_profiles(path, model, &chosen, "").expect_err("changed");
    assert!(fault.to_string().contains("that was judged"), "{fault}");
}
