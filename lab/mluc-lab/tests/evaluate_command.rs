//! `mluc-lab evaluate` as a person runs it: files in, JSON or a table or a clear error out.

use mluc_dataset::read_boxes;
use mluc_geometry::Box3;
use mluc_model::{Grid, Manifest, Network, formula_weights, model_bytes};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::process::{Command, Output};

const NO_CAMERA: &str = "P2: 0 0 0 0 0 0 0 0 0 0 0 0\nR0_rect: 1 0 0 0 1 0 0 0 1\n\
    Tr_velo_to_cam: 0 -1 0 0 0 0 -1 0 1 0 0 0\n";
const CAMERA: &str = "P2: 700 0 600 0 0 700 180 0 0 0 1 0\nR0_rect: 1 0 0 0 1 0 0 0 1\n\
    Tr_velo_to_cam: 0 -1 0 0 0 0 -1 -0.1 1 0 0 -0.3\n";

/// A car, a pedestrian, a van, a region without labels.
const LABELS: &str = "Car 0 0 0 0 0 100 100 1.5 1.6 4.0 -3 1.7 15 0.4\n\
    Pedestrian 0 1 0 0 0 100 100 1.7 0.6 0.8 4 1.7 12 -1\n\
    Van 0 0 0 0 0 100 100 2.1 1.9 5.0 0 1.7 25 1.5\n\
    DontCare -1 -1 -10 500 170 520 190 -1 -1 -1 -1000 -1000 -1000 -10\n";

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Folder {
        Folder(tempfile::tempdir().expect("a folder"))
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, content: &str) {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().expect("a parent")).expect("a folder");
        std::fs::write(path, content).expect("written");
    }

    /// Frames of the same labels under `part`, and the JSON lines of a detector that finds all of them.
    fn scene(&self, part: &str, calibration: &str, frames: usize) {
        let mut lines = String::new();
        for i in 0..frames {
            self.write(&format!("{part}/label_2/{i:06}.txt"), LABELS);
            self.write(&format!("{part}/calib/{i:06}.txt"), calibration);
            let objects = self.perfect_objects(part, i);
            lines.push_str(&line(&format!("{i:06}"), objects));
        }
        self.write(&format!("{part}/objects.jsonl"), &lines);
    }

    /// The boxes of a frame's labels: a car, a pedestrian, a van.
    fn boxes(&self, part: &str, i: usize) -> Vec<Box3> {
        let path = |folder: &str| self.path(&format!("{part}/{folder}/{i:06}.txt"));
        let boxes = read_boxes(&path("label_2"), &path("calib")).expect("boxes");
        boxes.into_iter().map(|(_, b)| b).collect()
    }

    fn perfect_objects(&self, part: &str, i: usize) -> Vec<Value> {
        let names = [
            ("known", "car"),
            ("known", "pedestrian"),
            ("unknown", "van"),
        ];
        let objects = names.into_iter().zip(self.boxes(part, i));
        objects
            .map(|((kind, label), b)| object(kind, label, 0.9, b))
            .collect()
    }

    fn evaluate(&self, parts: &[&str], more: &[&str]) -> Output {
        let mut arguments: Vec<PathBuf> = vec!["evaluate".into(), "ap".into()];
        for part in parts {
            let folder = self.path(part);
            arguments.extend(["--labels".into(), folder.join("label_2")]);
            arguments.extend(["--calib".into(), folder.join("calib")]);
            arguments.extend(["--detections".into(), folder.join("objects.jsonl")]);
        }
        run(&arguments, more)
    }

    fn json(&self, parts: &[&str], more: &[&str]) -> Value {
        json_of(&self.evaluate(parts, more))
    }
}

fn object(kind: &str, label: &str, score: f64, b: Box3) -> Value {
    json!({"kind": kind, "label": label, "score": score, "center_m": b.center_m, "size_m": b.size_m, "yaw_rad": b.yaw_rad,
        "eds": 1.0, "eds_normalised": 1.0, "points": 9, "footprint_m": []})
}

fn line(frame: &str, objects: Vec<Value>) -> String {
    let suppressed = json!([{"kind": "unknown", "reason": "overlaps_known", "by": 0}]);
    let line = json!({"wire": mluc_ipc_types::WIRE_VERSION, "sequence": 1, "frame": frame, "stamp_ns": 1, "objects": objects,
        "suppressed": suppressed, "stages": {}, "latency_us": 1, "flags": []});
    format!("{line}\n")
}

fn run(arguments: &[PathBuf], more: &[&str]) -> Output {
    let mut program = Command::new(env!("CARGO_BIN_EXE_mluc-lab"));
    program
        .args(arguments)
        .args(more)
        .output()
        .expect("the program runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn json_of(output: &Output) -> Value {
    assert!(output.status.success(), "{}", text(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("JSON on stdout")
}

const OPEN_SET: [&str; 5] = ["--json", "--unknown", "van,truck", "--unknown-iou", "0.1"];
const CAR: &str = "car/3d/moderate";

fn figure(report: &Value, key: &str, name: &str) -> f64 {
    let value = report[key][name].as_f64();
    value.unwrap_or_else(|| panic!("{key} {name}: not there"))
}

#[test]
fn a_perfect_detector_without_a_camera() {
    let folder = Folder::new();
    folder.scene("a", NO_CAMERA, 50);
    let report = folder.json(&["a"], &OPEN_SET);
    for class in ["car", "pedestrian", "unknown"] {
        for metric in ["bev", "3d"] {
            for name in ["ap_r11", "ap_r40", "ap_all"] {
                let found = figure(&report, &format!("{class}/{metric}/moderate"), name);
                assert_eq!(found, 100.0, "{class} {metric} {name}");
            }
        }
    }
    for name in ["map_known", "recall_unknown", "ap_unknown", "map_harm"] {
        assert_eq!(report[name], 100.0, "{name}");
        assert_eq!(report[format!("{name}_all")], 100.0, "{name}");
    }
    let rows = json!({"labels_found_as": {"unknown": 50}, "detections_lie_on": {"van": 50}});
    assert_eq!(report["unknown_confusion"], rows);
    // Nobody labelled a cyclist: its AP is 0 and map_known leaves it out.
    assert_eq!(figure(&report, "cyclist/3d/moderate", "ap_all"), 0.0);
}

/// The closed set has no open-set figures, and its keys are the devkit's nine a class.
#[test]
fn without_an_unknown_group_there_are_only_classes() {
    let folder = Folder::new();
    folder.scene("a", NO_CAMERA, 2);
    let report = folder.json(&["a"], &["--json"]);
    let keys = report.as_object().expect("an object");
    assert_eq!(keys.len(), 27);
    assert!(
        keys.keys().all(|key| key.split('/').count() == 3),
        "{keys:?}"
    );
}

#[test]
fn what_lies_outside_the_image_is_dropped_where_there_is_one() {
    for (calibration, size, expected) in [
        (CAMERA, "1242x375", 100.0),
        (CAMERA, "1500x375", 50.0),
        (NO_CAMERA, "1242x375", 50.0),
    ] {
        let folder = Folder::new();
        folder.scene("a", calibration, 1);
        let mut objects = folder.perfect_objects("a", 0);
        // A car from column 1284 on: a false alarm where the image reaches that far, or where there is none.
        let outside = Box3::new([20.0, -22.0, -0.9, 4.0, 1.6, 1.5, 0.0]);
        objects.push(object("known", "car", 0.95, outside));
        folder.write("a/objects.jsonl", &line("000000", objects));
        let report = folder.json(&["a"], &["--json", "--image-size", size]);
        assert_eq!(figure(&report, CAR, "ap_all"), expected, "{size}");
    }
}

#[test]
fn folders_with_the_same_frame_names_are_pooled() {
    let folder = Folder::new();
    folder.scene("a", CAMERA, 30);
    folder.scene("b", NO_CAMERA, 20);
    let both = folder.json(&["a", "b"], &OPEN_SET);
    assert_eq!(figure(&both, CAR, "ap_r40"), 100.0);
    // Thirty labels alone cannot reach 100 at 40 positions.
    let one = folder.json(&["a"], &OPEN_SET);
    assert!(figure(&one, CAR, "ap_r40") < 80.0);
    assert_eq!(figure(&one, CAR, "ap_all"), 100.0);
}

#[test]
fn frames_without_detections_count_and_are_warned_about() {
    let folder = Folder::new();
    folder.scene("a", NO_CAMERA, 2);
    folder.write(
        "a/objects.jsonl",
        &line("000001", folder.perfect_objects("a", 1)),
    );
    let output = folder.evaluate(&["a"], &["--json"]);
    assert_eq!(figure(&json_of(&output), CAR, "ap_all"), 50.0);
    let warnings = text(&output.stderr);
    for words in ["1 frames have labels but no detections", "000000"] {
        assert!(warnings.contains(words), "{warnings}");
    }
}

#[test]
fn overlaps_classes_and_neighbours_can_be_chosen() {
    let folder = Folder::new();
    folder.scene("a", NO_CAMERA, 1);
    let mut objects = folder.perfect_objects("a", 0);
    let [mut car, _, van] = folder.boxes("a", 0)[..] else {
        panic!("three labels")
    };
    // Moved by a fifth of its length: IoU 2/3.
    car.center_m[0] += 0.8 * car.yaw_rad.cos();
    car.center_m[1] += 0.8 * car.yaw_rad.sin();
    objects[0] = object("known", "car", 0.9, car);
    // The van, called a car.
    objects.push(object("known", "car", 0.99, van));
    folder.write("a/objects.jsonl", &line("000000", objects));
    for (options, expected) in [
        ("--json", 0.0),
        ("--json --iou car=0.5,pedestrian=0.25", 100.0),
        ("--json --iou car=0.5 --neighbours strict", 50.0),
    ] {
        let options: Vec<&str> = options.split(' ').collect();
        let found = figure(&folder.json(&["a"], &options), CAR, "ap_all");
        assert_eq!(found, expected, "{options:?}");
    }
    let only = folder.json(&["a"], &["--json", "--classes", "car"]);
    assert_eq!(only.as_object().expect("an object").len(), 9);
}

#[test]
fn without_json_a_table_is_printed() {
    let folder = Folder::new();
    folder.scene("a", NO_CAMERA, 2);
    let output = folder.evaluate(&["a"], &OPEN_SET[1..]);
    let table = text(&output.stdout);
    assert!(output.status.success());
    let classes = ["car", "pedestrian", "unknown"];
    let others = [
        "2 frames, 6 detections",
        "harmonic mean",
        "found as",
        "2 van",
    ];
    for word in classes.into_iter().chain(others) {
        assert!(table.contains(word), "{word}: {table}");
    }
}

#[test]
fn bad_input_is_named_and_fails() {
    let folder = Folder::new();
    folder.scene("a", NO_CAMERA, 2);
    let good = std::fs::read_to_string(folder.path("a/objects.jsonl")).expect("lines");
    let fault = |more: &[&str], words: &[&str]| {
        let output = folder.evaluate(&["a"], more);
        let message = text(&output.stderr);
        assert!(!output.status.success() && output.stdout.is_empty());
        for word in words {
            assert!(message.contains(word), "{word}: {message}");
        }
    };
    fault(
        &["--labels", "elsewhere"],
        &["--detections", "(2)", "found 1"],
    );
    fault(&["--iou", "car"], &["CLASS=IOU", "car"]);
    fault(&["--iou", "car=1.5"], &["overlap of car", "1.5"]);
    fault(&["--unknown", "van", "--iou", "van=0.5"], &["van", "both"]);
    fault(&["--image-size", "big"], &["WIDTHxHEIGHT", "big"]);

    let short = LABELS.split_once(" 15 0.4").expect("the car's end").0;
    let (cut, renamed) = (&good[..good.len() - 20], good.replace("\"00000", "\"77777"));
    let columns = ["000001.txt, line 1", "15 or 16 columns", "found 13", "no z"];
    for (file, content, words) in [
        ("a/label_2/000001.txt", short, &columns[..]),
        (
            "a/calib/000001.txt",
            "P2: 0 0\n",
            &["calib/000001.txt, line 1", "12 columns", "found 2"],
        ),
        ("a/objects.jsonl", cut, &["objects.jsonl, line 2"]),
        (
            "a/objects.jsonl",
            &renamed,
            &["found none", "777770", "000000"],
        ),
    ] {
        let whole = std::fs::read_to_string(folder.path(file)).expect("a file");
        folder.write(file, content);
        fault(&[], words);
        folder.write(file, &whole);
    }
    std::fs::remove_file(folder.path("a/objects.jsonl")).expect("removed");
    fault(&[], &["folder of detection files or a file of JSON lines"]);
    folder.write("a/objects.jsonl", &good);
    std::fs::remove_dir_all(folder.path("a/label_2")).expect("removed");
    std::fs::create_dir(folder.path("a/label_2")).expect("made");
    fault(&[], &["label files (*.txt)", "found none"]);
}

/// JSON lines cannot be judged without a calibration; detection files of a folder can.
#[test]
fn json_lines_need_a_calibration_and_folders_do_not() {
    let folder = Folder::new();
    folder.scene("a", NO_CAMERA, 1);
    let with = |detections: &str| {
        let command = ["evaluate".into(), "ap".into(), "--labels".into()];
        let more = [
            folder.path("a/label_2"),
            "--detections".into(),
            folder.path(detections),
        ];
        run(&[command, more].concat(), &["--json"])
    };
    let refused = with("a/objects.jsonl");
    assert!(!refused.status.success() && text(&refused.stderr).contains("--calib"));
    let scored = LABELS.lines().take(2).map(|line| format!("{line} 0.9\n"));
    folder.write("a/found/000000.txt", &scored.collect::<String>());
    assert_eq!(figure(&json_of(&with("a/found")), CAR, "ap_all"), 100.0);
    folder.write("a/found/000000.txt", LABELS);
    assert!(text(&with("a/found").stderr).contains("no score"));
}

/// Weights by formula on a small map: nothing is learned, but every stage has work.
fn model() -> Vec<u8> {
    let grid = Grid {
        range_min_m: [-12.8, -12.8, -5.0],
        range_max_m: [12.8, 12.8, 3.0],
        ..Grid::udi()
    };
    let mut manifest = Manifest::untrained("udi", Network::compact(grid, 4));
    manifest.thresholds.candidates_max = 300;
    model_bytes(&manifest, &formula_weights(&manifest.network)).expect("a model")
}

#[test]
fn a_model_is_judged_and_faults_are_named() {
    let folder = Folder::new();
    let [data, model_file, boxes] = ["val", "model.safetensors", "boxes.jsonl"]
        .map(|name| folder.path(name).to_string_lossy().into_owned());
    let simulate = "simulate --family sim-udi --split val --frames 2 --seed 3 --out";
    let simulate: Vec<PathBuf> = simulate.split(' ').map(PathBuf::from).collect();
    assert!(run(&simulate, &[&data]).status.success());
    std::fs::write(&model_file, model()).expect("written");

    let evaluate = |more: &[&str]| {
        let given = ["model", "--model", &model_file, "--data", &data];
        run(&["evaluate".into()], &[&given[..], more].concat())
    };
    let options = ["--split", "val", "--sweep", "--json", "--boxes", &boxes];
    let report = json_of(&evaluate(&options));
    assert_eq!(report["frames"], 2);
    assert!(report["closed"]["truck/3d/moderate"]["ap_r40"].is_number());
    let points = report["sweep"].as_array().map_or(0, Vec::len);
    assert!(points > 2, "{points}");
    assert_eq!(report["separation"].as_array().map(Vec::len), Some(7));
    let lines = std::fs::read_to_string(&boxes).expect("boxes");
    assert_eq!(lines.lines().count(), 2);
    assert!(text(&evaluate(&["--refiner", "none"]).stdout).contains("closed set"));

    let fault = |more: &[&str], words: &[&str]| {
        let output = evaluate(more);
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{message}");
        assert!(words.iter().all(|word| message.contains(word)), "{message}");
    };
    fault(&["--split", "test"], &["ImageSets", "test.txt"]);
    fault(&["--frames", "0"], &["--frames"]);
    let unrecognized = ["--write-threshold", "--unknown", "spaceship"];
    fault(&unrecognized, &["spaceship", "found none"]);
    std::fs::remove_file(folder.path("val/label_2/000001.txt")).expect("removed");
    fault(&[], &["frame 000001", "expected labels"]);
}
