//! Several LiDARs as one frame: half scans together give the objects of the whole scans; without one sensor the frames continue.

use mluc_dataset::scan_bytes;
use mluc_model::Model;
use mluc_tests::{Finished, Running, Setting, root, write_file};
use serde_json::Value;

/// The second LiDAR hangs upside down and faces left.
const LIDARS: &str = include_str!("several/lidars.toml");

/// The program's own scans whole, and split between two sensors; the second sensor has no third scan.
fn write_scans(setting: &Setting) {
    let folder = setting.folder.path();
    // A point of the first sensor in the coordinates of the second one.
    let in_rear = |&[x, y, z, intensity]: &[f32; 4]| [y - 0.5, x + 1.5, -z - 0.25, intensity];
    for name in ["000010", "000080", "000209", "000380"] {
        let path = root().join(format!("services/mluc/assets/{name}.bin.zst"));
        let bytes = zstd::decode_all(std::fs::File::open(path).expect("a scan")).expect("points");
        let points = bytes.chunks_exact(16).map(bytemuck::pod_read_unaligned::<[f32; 4]>);
        let (front, rear): (Vec<_>, Vec<_>) = points.partition(|p| p[0] > p[1]);
        let moved: Vec<_> = rear.iter().map(in_rear).collect();
        let whole = [&front[..], &rear].concat();
        for (sensor, points) in [("whole", whole), ("front", front), ("rear", moved)] {
            let path = folder.join(format!("{sensor}/{name}.bin"));
            write_file(&path, scan_bytes(&points));
        }
    }
    let _ = std::fs::remove_file(folder.join("rear/000209.bin"));
    for (sensor, ms) in [("front", "100 200 300 400"), ("rear", "140 160 440")] {
        let stamps = ms.split(' ').map(|ms| format!("2026-01-01 00:00:00.{ms}\n"));
        let path = folder.join(format!("{sensor}/timestamps.txt"));
        write_file(&path, stamps.collect::<String>());
    }
}

fn up(setting: &Setting, options: &str) -> Finished {
    let instance = &setting.instance;
    let words = format!("up --instance {instance} --pace complete --precision f32 {options}");
    setting.finish(Running::mluc(words.split_whitespace()))
}

#[test]
fn halves_are_one_scan_and_a_sensor_that_is_missing_is_told() {
    let setting = Setting::new("several", 0);
    write_scans(&setting);
    let input = setting.folder.path().join("whole");
    let whole = up(&setting, &format!("--input {}", input.display()));
    let merged = up(&setting, &setting.config(LIDARS));
    merged.assert_complete(0, 4);
    let tracked = up(&setting, &format!("--track --input {}", input.display()));
    let model = Model::read(&root().join("weights/any-open.safetensors")).expect("a model");
    let table = model.manifest.thresholds.probabilities.expect("a table");
    for (number, (whole, merged)) in whole.lines.iter().zip(&merged.lines).enumerate() {
        let has_flag = merged["flags"].to_string().contains("\"degraded\"");
        assert_eq!(has_flag, number == 2, "{merged}");
        let objects = |line: &Value| line["objects"].as_array().expect("objects").clone();
        let [whole, merged] = [objects(whole), objects(merged)];
        let axis = |o: &Value, i: usize| o["center_m"][i].as_f64().expect("a number");
        let is_near = |a: &Value, b: &Value| {
            a["label"] == b["label"] && (0..3).all(|i| (axis(a, i) - axis(b, i)).abs() < 0.05)
        };
        for object in &whole {
            let [x_m, y_m, z_m] = [0, 1, 2].map(|i| axis(object, i));
            let is_known = object["kind"] == "known";
            assert!(!is_known || z_m < 0.5, "it stands on the ground: {object}");
            let told = object["probability"].as_f64().expect("a number");
            let score = object["score"].as_f64().expect("a number");
            let expected = table.of(is_known, x_m.hypot(y_m) as f32, score as f32);
            assert!((told - f64::from(expected.expect("a table"))).abs() < 0.003);
        }
        // What is not confirmed takes nobody's place.
        let mut hidden = tracked.lines[number]["suppressed"].as_array().expect("objects").iter();
        let gave_way = |o: &&Value| o["kind"] == "known" && o["reason"] == "overlaps_unknown";
        assert!(hidden.all(|o| !gave_way(&o) || !o["by"].is_null()));
        let is_there = |object| merged.iter().any(|other| is_near(object, other));
        let is_same = whole.len() == merged.len() && whole.iter().all(is_there);
        assert_eq!(is_same, number != 2, "{whole:?} {merged:?}");
        assert!(!merged.is_empty(), "{number}");
    }
    let missing = "lidar rear is missing: frames go on without it";
    merged.assert_says(&[missing, "lidar rear is back: 1 frames", "degraded 1"]);
    let renamed = LIDARS.replacen("'rear'\nex", "'back'\nex", 1);
    let gone = up(&setting, &setting.config(&renamed));
    assert!(gone.code != Some(0) && gone.lines.is_empty(), "{}", gone.log);
    gone.assert_says(&["[[lidar]] rear: input"]);
}
