//! `mluc-lab evaluate`.

use crate::{Folder, text};
use mluc_dataset::{read_boxes, scan_bytes};
use mluc_geometry::Box3;
use mluc_tests::{NO_CAMERA, assert_has, untrained_udi};
use serde_json::{Value, json};

const CAMERA: &str = "P2: 700 0 600 0 0 700 180 0 0 0 1 0\nR0_rect: 1 0 0 0 1 0 0 0 1\n\
    Tr_velo_to_cam: 0 -1 0 0 0 0 -1 -0.1 1 0 0 -0.3\n";

/// A car, a pedestrian, a van, and a region without labels.
const LABELS: &str = "Car 0 0 0 0 0 100 100 1.5 1.6 4.0 -3 1.7 15 0.4\n\
    Pedestrian 0 1 0 0 0 100 100 1.7 0.6 0.8 4 1.7 12 -1\n\
    Van 0 0 0 0 0 100 100 2.1 1.9 5.0 0 1.7 25 1.5\n\
    DontCare -1 -1 -10 500 170 520 190 -1 -1 -1 -1000 -1000 -1000 -10\n";

const FOUND: &str = "a/objects.jsonl";
const OPEN_SET: &str = "--json --unknown van,truck --unknown-iou 0.1";
const CAR: &str = "car/3d/moderate";

impl Folder {
    /// Writes frames with the same labels under `part`, and the JSON lines of a detector that finds all of them.
    fn scene(&self, part: &str, calibration: &str, frames: usize) {
        let mut lines = String::new();
        for i in 0..frames {
            self.write(&format!("{part}/label_2/{i:06}.txt"), LABELS);
            self.write(&format!("{part}/calib/{i:06}.txt"), calibration);
            lines += &line(&format!("{i:06}"), self.perfect_objects(part));
        }
        self.write(&format!("{part}/objects.jsonl"), lines);
    }

    /// The boxes of a frame's labels: a car, a pedestrian, a van.
    fn boxes(&self, part: &str) -> Vec<Box3> {
        let path = |folder: &str| self.path(&format!("{part}/{folder}/000000.txt"));
        let boxes = read_boxes(&path("label_2"), &path("calib")).expect("boxes");
        boxes.into_iter().map(|(_, b)| b).collect()
    }

    fn perfect_objects(&self, part: &str) -> Vec<Value> {
        let kinds = ["known", "known", "unknown"];
        let objects = kinds.into_iter().zip(["car", "pedestrian", "van"]).zip(self.boxes(part));
        objects.map(|((kind, label), b)| object(kind, label, 0.9, b)).collect()
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

/// The words of a command that judges the folders `parts`.
fn ap(parts: &str, more: &str) -> String {
    judging("ap", parts, more)
}

fn judging(what: &str, parts: &str, more: &str) -> String {
    let part = |part| {
        format!("--labels {part}/label_2 --calib {part}/calib --detections {part}/objects.jsonl")
    };
    let parts: Vec<String> = parts.split(' ').map(part).collect();
    format!("evaluate {what} {} {more}", parts.join(" "))
}

fn figure(report: &Value, key: &str, name: &str) -> f64 {
    report[key][name].as_f64().unwrap_or_else(|| panic!("{key} {name}: not there"))
}

#[test]
fn a_perfect_detector_without_a_camera() {
    let folder = Folder::new();
    folder.scene("a", NO_CAMERA, 50);
    let report = folder.json(&ap("a", OPEN_SET));
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
    // No label is a cyclist: its AP is 0 and map_known leaves it out.
    assert_eq!(figure(&report, "cyclist/3d/moderate", "ap_all"), 0.0);

    let table = folder.run(&ap("a", OPEN_SET.trim_start_matches("--json")));
    let table = text(&table.stdout);
    assert_has(&table, &["car", "pedestrian", "unknown", "harmonic mean"]);
    assert_has(&table, &["50 frames, 150 detections"]);

    // The closed set has no open-set figures: its keys are the devkit's nine per class, and AP by range.
    let report = folder.json(&ap("a", "--json"));
    let keys: Vec<&String> = report.as_object().expect("an object").keys().collect();
    let is_of_class = |key: &&&String| key.split('/').count() == 3;
    let of_class = keys.iter().filter(is_of_class).count();
    assert!(keys.len() == 28 && of_class == 27, "{keys:?}");
    assert_eq!(report["by_range"]["car"]["15-30 m"]["labels"], 50);
}

#[test]
fn what_lies_outside_the_image_is_dropped_where_there_is_one() {
    for (calibration, size, expected) in [
        (CAMERA, "", 100.0),
        (CAMERA, "--image-size 1500x375", 50.0),
        (CAMERA, "--image-size 1242x375", 100.0),
        (NO_CAMERA, "--image-size 1242x375", 50.0),
    ] {
        let folder = Folder::new();
        folder.scene("a", calibration, 1);
        let mut objects = folder.perfect_objects("a");
        // A car from column 1284 on: a false alarm where the image reaches that far, or where there is none.
        let outside = Box3::new([20.0, -22.0, -0.9, 4.0, 1.6, 1.5, 0.0]);
        objects.push(object("known", "car", 0.95, outside));
        folder.write(FOUND, line("000000", objects));
        let report = folder.json(&ap("a", &format!("--json {size}")));
        assert_eq!(figure(&report, CAR, "ap_all"), expected, "{size}");
    }
}

#[test]
fn beyond_the_longest_range_nothing_is_right_or_wrong() {
    let folder = Folder::new();
    folder.scene("a", NO_CAMERA, 1);
    // The pedestrian is 12.6 m away, the car 15.3 m, the van 25 m. The car is found 14.9 m away; a false car is 20 m away.
    let mut objects = folder.perfect_objects("a");
    objects[0]["center_m"][0] = json!(14.6);
    objects.push(object("known", "car", 0.95, Box3::new([20.0, 0.0, -0.9, 4.0, 1.6, 1.5, 0.0])));
    folder.write(FOUND, line("000000", objects));
    let judge =
        |what, range: &str| folder.json(&judging(what, "a", &format!("{OPEN_SET} {range}")));
    let cars = |report: &Value| report["by_range"]["car"]["15-30 m"]["labels"].clone();
    for (range, car, labels) in
        [("", 50.0, 1), ("--range-max-m 16", 100.0, 1), ("--range-max-m 15", 0.0, 0)]
    {
        let report = judge("ap", &format!("--iou car=0.5 {range}"));
        assert_eq!(figure(&report, CAR, "ap_all"), car, "{range}");
        assert_eq!(cars(&report), labels, "{range}");
        assert_eq!(report["recall_unknown"], if range.is_empty() { 100.0 } else { 0.0 });
    }
    // Without its label, the car that is found remains on one: known objects are 2, and none is wrong.
    let near = &judge("operating", "--range-max-m 15")["known"][0];
    let figures = ["objects", "on_no_label", "recall"].map(|name| near[name][0].clone());
    assert_eq!(figures, [json!(2.0), json!(0.0), json!(100.0)], "{near}");
}

#[test]
fn frames_without_detections_count_and_are_warned_about() {
    let folder = Folder::new();
    folder.scene("a", NO_CAMERA, 2);
    folder.write(FOUND, line("000001", folder.perfect_objects("a")));
    let output = folder.run(&ap("a", "--json"));
    let report = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(figure(&report, CAR, "ap_all"), 50.0);
    let warnings = text(&output.stderr);
    let words = ["1 frames have labels but no detections", "000000"];
    assert_has(&warnings, &words);
}

#[test]
fn overlaps_and_classes_can_be_chosen() {
    let folder = Folder::new();
    folder.scene("a", NO_CAMERA, 1);
    let mut objects = folder.perfect_objects("a");
    let [mut car, _, van]: [Box3; 3] = folder.boxes("a").try_into().expect("three");
    // The car is moved by a fifth of its length: IoU 2/3.
    car.center_m[0] += 0.8 * car.yaw_rad.cos();
    car.center_m[1] += 0.8 * car.yaw_rad.sin();
    objects[0] = object("known", "car", 0.9, car);
    // The van is reported as a car.
    objects.push(object("known", "car", 0.99, van));
    folder.write(FOUND, line("000000", objects));
    for (options, expected) in [("--json", 0.0), ("--json --iou car=0.5,pedestrian=0.25", 100.0)] {
        let found = figure(&folder.json(&ap("a", options)), CAR, "ap_all");
        assert_eq!(found, expected, "{options}");
    }
    let only = folder.json(&ap("a", "--json --classes car"));
    assert_eq!(only.as_object().expect("an object").len(), 10);
}

#[test]
fn bad_input_is_named_and_fails() {
    let folder = Folder::new();
    folder.scene("a", NO_CAMERA, 2);
    for (options, words) in [
        ("--labels elsewhere", ["--detections", "(2)", "found 1"]),
        ("--iou car", ["CLASS=IOU", "car", "found"]),
        ("--iou car=1.5", ["overlap of car", "1.5", "found"]),
        ("--unknown van --iou van=0.5", ["van", "both", "found"]),
        ("--image-size big", ["--image-size", "expected WIDTHxHEIGHT", "found 'big'"]),
        ("--image-size 0x375", ["--image-size", "expected WIDTHxHEIGHT", "found '0x375'"]),
        ("--range-max-m 0", ["--range-max-m", "expected metres above 0", "found '0'"]),
    ] {
        folder.refuses(&ap("a", options), &words);
    }
    let short = LABELS.split_once(" 15 0.4").expect("the car's end").0;
    let renamed = text(&folder.read(FOUND)).replace("\"00000", "\"77777");
    let label = "a/label_2/000001.txt";
    for (file, content, words) in [
        (label, short, ["000001.txt, line 1", "found 13", "no z"]),
        (FOUND, &renamed, ["found none", "777770", "000000"]),
    ] {
        let refuses = || folder.refuses(&ap("a", ""), &words);
        folder.with(file, |_| content.into(), refuses);
    }
    let refuses = |words: &[&str]| folder.refuses(&ap("a", ""), words);
    std::fs::rename(folder.path(FOUND), folder.path("moved")).expect("moved");
    refuses(&["folder of detection files or a file of JSON lines"]);
    std::fs::rename(folder.path("moved"), folder.path(FOUND)).expect("moved");
    std::fs::remove_dir_all(folder.path("a/label_2")).expect("removed");
    std::fs::create_dir(folder.path("a/label_2")).expect("made");
    refuses(&["label files (*.txt)", "found none"]);
}

#[test]
fn two_models_are_compared_on_the_same_draws_of_scans() {
    let folder = Folder::new();
    folder.scene("a", NO_CAMERA, 40);
    let half = (0..40).step_by(2);
    let half = half.map(|at| line(&format!("{at:06}"), folder.perfect_objects("a")));
    folder.write("half.jsonl", half.collect::<String>());
    let with = |more: &str| ap("a", &format!("--classes car --beside {more}"));
    let report = folder.json(&with("half.jsonl --json"));
    let car = &report["beside"][1];
    assert_eq!(car["ap"], json!([100.0, 100.0, 100.0]));
    let [difference, low, high] = [0, 1, 2].map(|at| car["difference"][at].as_f64().expect("AP"));
    assert!(difference == 50.0 && (30.0..50.0).contains(&low) && (50.0..70.0).contains(&high));
    let same = text(&folder.run(&with(FOUND)).stdout);
    assert_has(&same, &["difference", "0.0 [0.0, 0.0]"]);
    let twice = with("half.jsonl --beside half.jsonl");
    folder.refuses(&twice, &["expected as many --beside", "(1)", "found 2"]);
}

/// JSON lines cannot be judged without a calibration; a folder of detection files can.
#[test]
fn json_lines_need_a_calibration_and_folders_do_not() {
    let folder = Folder::new();
    folder.scene("a", NO_CAMERA, 1);
    let with = |found: &str| format!("evaluate ap --json --labels a/label_2 --detections {found}");
    folder.refuses(&with(FOUND), &["--calib"]);
    let scored = LABELS.lines().take(2).map(|line| format!("{line} 0.9\n"));
    folder.write("a/found/000000.txt", scored.collect::<String>());
    let report = folder.json(&with("a/found"));
    assert_eq!(figure(&report, CAR, "ap_all"), 100.0);
    folder.write("a/found/000000.txt", LABELS);
    folder.refuses(&with("a/found"), &["no score"]);
}

#[test]
fn objects_on_no_label_are_counted_at_each_score() {
    let folder = Folder::new();
    folder.scene("a", NO_CAMERA, 2);
    folder.scene("b", NO_CAMERA, 2);
    let ghost = Box3::new([30.0, 20.0, -0.9, 4.0, 1.6, 1.5, 0.0]);
    let mut objects = folder.perfect_objects("a");
    objects.push(object("unknown", "unknown", 0.5, ghost));
    let lines = ["000000", "000001"].map(|frame| line(frame, objects.clone()));
    folder.write(FOUND, lines.concat());
    let report = folder.json(&judging("operating", "a b", OPEN_SET));
    let [published, curve] = &report["unknown"].as_array().expect("points")[..] else {
        panic!("two points: {report}")
    };
    for (point, name, no_label) in [(published, "published", 0.5), (curve, "at most 0.3", 0.0)] {
        assert_eq!(point["name"], name);
        assert_eq!(point["on_no_label"][0], no_label);
        assert_eq!(point["the_same_an_hour"][0], no_label * 36_000.0);
        assert_eq!(point["on_unknown"], json!([1.0, 1.0, 1.0]));
        assert_eq!(point["recall"][0], 100.0);
    }
    // One of the two drives has none.
    assert_eq!(published["on_no_label"], json!([0.5, 0.0, 1.0]));
    assert_eq!(report["known"].as_array().map(Vec::len), Some(1));
    assert_eq!(report["by_range"]["van"]["15-30 m"]["recall"], 100.0);
    let table = folder.run(&judging("operating", "a b", "--unknown van,truck"));
    let words = ["4 scans", "at most 0.3", "0.50 [0.00, 1.00]", "truck"];
    assert_has(&text(&table.stdout), &words);
    // An object on a truck is no false van.
    folder.scene("c", NO_CAMERA, 1);
    let truck = "Truck 0 0 0 0 0 100 100 3 2.5 8 9 1.7 20 0\n";
    folder.write("c/label_2/000000.txt", format!("{LABELS}{truck}"));
    let mut objects = folder.perfect_objects("c");
    objects.push(object("unknown", "unknown", 0.95, folder.boxes("c")[3]));
    folder.write("c/objects.jsonl", line("000000", objects));
    let report = folder.json(&judging("operating", "c", OPEN_SET));
    assert_eq!(report["by_range"]["van"]["15-30 m"]["ap_all"], 100.0);
}

#[test]
fn rings_on_objects_are_counted_in_the_scans() {
    let folder = Folder::new();
    folder.scene("a", NO_CAMERA, 1);
    folder.refuses(&ap("a", "--scans b"), &["b/000000.bin"]);
    // Two beams hit the car, one hits the pedestrian.
    let [car, person, _]: [Box3; 3] = folder.boxes("a").try_into().expect("three");
    let point = |b: &Box3, up_m: f64| {
        let [x, y, z] = b.center_m;
        [x, y, z + up_m, 0.0].map(|v| v as f32)
    };
    let points = [point(&car, 0.3), point(&car, -0.3), point(&person, 0.0)];
    folder.write("b/000000.bin", scan_bytes(&points));
    let rings = folder.json(&ap("a", "--json --scans b"));
    for (class, bin) in [("car", "2"), ("pedestrian", "1")] {
        let figures = &rings["by_rings"][class][bin];
        let figures = [&figures["labels"], &figures["ap_all"]];
        assert_eq!(figures, [&json!(1), &json!(100.0)], "{rings}");
    }
}

#[test]
fn a_model_is_judged_and_faults_are_named() {
    let folder = Folder::new();
    folder.run("simulate --family sim-udi --split val --frames 2 --seed 3 --out val");
    folder.write("model.safetensors", untrained_udi());

    let model = |more: &str| format!("evaluate model --model model.safetensors --data val {more}");
    let report = folder.json(&model("--split val --sweep --json"));
    assert_eq!(report["frames"], 2);
    assert!(report["closed"]["truck/3d/moderate"]["ap_r40"].is_number());
    let points = report["sweep"].as_array().map_or(0, Vec::len);
    assert!(points > 2, "{points}");
    assert_eq!(report["separation"].as_array().map(Vec::len), Some(6));
    assert!(report["by_rings"]["car"]["9 on"]["labels"].is_number());
    // The network runs in two jobs.
    for shard in ["0/2", "1/2"] {
        let part = format!("--shard {shard} --write-part part{}", &shard[..1]);
        folder.run(&model(&part));
    }
    let whole = folder.run(&model("--sweep --json")).stdout;
    let parts = folder.run(&model("--sweep --json --parts part0 part1"));
    assert_eq!(parts.stdout, whole);
    for line in include_str!("refused.txt").lines() {
        let words: Vec<&str> = line.split(" | ").collect();
        folder.refuses(&model(words[0]), &words[1..]);
    }
    let cut = |bytes: &[u8]| bytes[..bytes.len() - 1].to_vec();
    let words = ["frame 000001: expected", "found"];
    let refuses = || folder.refuses(&model("--parts part1"), &words);
    folder.with("part1", cut, refuses);
    let more = |bytes: &[u8]| [bytes, b"0"].concat();
    let words = ["expected no bytes behind", "found 1"];
    let refuses = || folder.refuses(&model("--parts part1"), &words);
    folder.with("part1", more, refuses);
    let table = folder.run(&model("--refiner range-scaled --write-profiles"));
    let words = ["closed set", "written: profile quiet"];
    assert_has(&text(&table.stdout), &words);
    std::fs::remove_file(folder.path("val/label_2/000001.txt")).expect("removed");
    folder.refuses(&model(""), &["frame 000001", "expected labels"]);
}
