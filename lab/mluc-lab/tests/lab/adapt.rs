//! `mluc-lab adapt`, with the smallest possible settings.

use crate::{Folder, text};
use mluc_model::Model;
use mluc_tests::assert_has;

#[test]
fn a_model_is_adapted_once_and_goes_on_where_it_was() {
    let folder = Folder::new();
    folder.run("sensor --sensor vlp-16 --picture vlp-16.png");
    let profile = "name = \"mine\"\nsource = \"a test\"\nelevations_deg = [4.0, 2.0, 0.0, -2.0, -4.0, -8.0]\n\
        azimuth_step_deg = 0.8\nrange_m = [0.5, 60.0]\nrange_noise_m = 0.02\nheight_m = 1.5\n";
    folder.write("mine.toml", profile);
    let adapt = |more: &str| format!("adapt --sensor mine.toml --out a {more}");
    let few = "--known car,pedestrian,forklift --hours 0.001";
    let output = folder.run(&adapt(few));
    let said = "probe|12 scans and 30 to judge by|9 steps of 4|teach little";
    let said: Vec<&str> = said.split('|').collect();
    assert_has(&text(&output.stderr), &said);
    let report = text(&folder.read("a/report.md"));
    let words = ["Adapted to mine", "| forklift |", "| - |", "unknown, AP"];
    assert_has(&report, &words);
    let bytes = folder.read("a/model.safetensors");
    let manifest = Model::from_bytes(&bytes).expect("a model").manifest;
    let classes: Vec<&str> = manifest.classes.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(classes, ["car", "pedestrian", "forklift"]);
    let from = manifest.provenance;
    assert!(!from.calibration.is_empty() && !from.profile_choice.is_empty());
    assert_eq!((from.steps, manifest.sensor_height_m), (9, 1.5));

    // A second run repeats nothing; missing files are made again with the same content.
    std::fs::remove_file(folder.path("a/model.safetensors")).expect("removed");
    std::fs::remove_file(folder.path("a/report.md")).expect("removed");
    std::fs::remove_file(folder.path("a/scans/train/planes/000003.txt")).expect("removed");
    let output = folder.run(&adapt(few));
    assert!(!text(&output.stderr).contains("probe"));
    assert!(folder.read("a/model.safetensors") == bytes);
    assert_eq!(text(&folder.read("a/report.md")), report);
    // Its scans may be deleted.
    std::fs::remove_dir_all(folder.path("a/scans")).expect("removed");
    folder.run(&adapt(few));
    assert!(!folder.path("a/scans").exists());
    folder.write("m/model.safetensors", "mine");
    let other = ["expected nothing of another run (plan.json is missing)"];
    folder.refuses("adapt --sensor mine.toml --out m", &other);
    std::fs::remove_file(folder.path("m/model.safetensors")).expect("removed");
    folder.write("m/scans/train/velodyne/000000.bin", "");
    folder.refuses("adapt --sensor mine.toml --out m", &other);
    let init = "adapt --sensor mine.toml --init mine.toml --out n";
    folder.refuses(init, &["mine.toml: model file"]);
    let others = ["--sensor, --known, --hours", "name another folder"];
    folder.refuses(&adapt("--hours 2"), &others);
    folder.refuses(&adapt("--hours 0"), &["more than 0"]);
    folder.refuses(&adapt("--known car,tank"), &["expected one of car", "tank"]);
    let few = "--known: expected 2 to 8 classes, found 1";
    folder.refuses(&adapt("--known car"), &[few]);
    folder.write("fine.toml", profile.replace("= 0.8", "= 0.004"));
    let fine = ["expected at most 262144 rays", "found 540000"];
    folder.refuses("adapt --sensor fine.toml --out b", &fine);

    // The folder of a pair is checked first.
    folder.write("c-pair/mine", "");
    let pair = "simulate --family sim-any --split val --frames 1 --pair mine.toml --out c/";
    folder.refuses(pair, &["c-pair: expected an empty or a new folder"]);
    assert!(!folder.path("c").exists());
}
