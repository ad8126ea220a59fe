//! `mluc-lab reproduce` on a plan of a minute: everything is simulated, trained, judged and reported; a second run only checks.

use crate::{Folder, text};
use mluc_tests::{assert_has, untrained_udi};
use serde_json::Value;

const ROWS: &str = "closed-set supervised naive osis osis-geo ml-only uc-only paper paper-corrected mluc-open mluc-full";
const FIGURES: &str = "map_known ap_unknown map_harm recall_unknown ap_unknown_iou25_r11";
const REPRODUCE: &str = "reproduce --setting kitti --smoke --data data --runs runs --out report";

fn report(folder: &Folder) -> Value {
    serde_json::from_slice(&folder.read("report/report.json")).expect("JSON")
}

#[test]
fn everything_is_made_once_and_what_is_lost_is_made_again_to_the_same_bits() {
    let folder = Folder::new();
    folder.run(REPRODUCE);
    let first = report(&folder);
    for row in ROWS.split(' ') {
        let figures = &first["sim-kitti"][row];
        for name in FIGURES.split(' ') {
            let value = figures[name].as_array();
            let is_pair = value.is_some_and(|v| v.len() == 2 && v.iter().all(Value::is_f64));
            assert!(is_pair, "{row}: {name}");
        }
        assert_eq!(figures["spread"], "bootstrap");
    }
    let networks = &first["details"]["sim-kitti"]["networks"];
    let networks = networks.as_array().expect("networks");
    assert_eq!(networks.len(), 7);
    for network in networks {
        let command = network["command"].as_str().expect("a command");
        assert!(command.starts_with("mluc-lab train"), "{command}");
    }
    let page = text(&folder.read("report/README.md"));
    assert_has(&page, &["Table 1", "Table 2", "66.8", "figure5.svg"]);
    assert!(text(&folder.read("report/figure5.svg")).starts_with("<svg"));
    assert!(folder.read("report/figure6.png").starts_with(b"\x89PNG"));

    // One evaluation and a network are lost: both are made again, everything else is left unchanged.
    let lost = folder.path("runs/sim-kitti");
    std::fs::remove_file(lost.join("evaluations/ml-only.json")).expect("it was there");
    std::fs::remove_dir_all(lost.join("mluc-full")).expect("it was there");
    let told = text(&folder.run(REPRODUCE).stderr);
    assert!(told.contains("train mluc-full"), "{told}");
    assert!(!told.contains("train metric") && !told.contains("simulate"), "{told}");
    assert_eq!(report(&folder), first);
}

#[test]
fn faults_are_told_with_what_was_expected_and_found() {
    let folder = Folder::new();
    let refuses = |words| folder.refuses(&format!("{REPRODUCE} --no-train"), &[words]);
    // A user's folder in the place of a split.
    let test = "data/sim-kitti/test";
    folder.write(&format!("{test}/notes.txt"), "mine");
    refuses("data/sim-kitti/test: expected a data set of at least 6 frames, found 0");
    assert!(folder.path(test).join("notes.txt").is_file());
    std::fs::remove_dir_all(folder.path(test)).expect("removed");

    refuses("runs: expected a trained network of at least one kind");

    // A model of the other setting is refused.
    folder.write("runs/sim-kitti/metric/model.safetensors", untrained_udi());
    refuses("expected a model of setting kitti, found udi");

    // Recorded scans are checked first.
    let real = "reproduce --quick --real nowhere --data made --runs runs --out out";
    folder.refuses(real, &["nowhere"]);
    folder.refuses(&format!("{real} --setting udi"), &["--setting kitti"]);
    // The lists of both splits are also checked first.
    for file in ["velodyne/0.bin", "label_2/0.txt", "calib/0.txt"] {
        folder.write(&format!("kitti/training/{file}"), [0u8; 16]);
    }
    folder.write("kitti/ImageSets/train.txt", "0\n");
    let kitti = "reproduce --dataset kitti --root kitti --data made --runs runs --out out";
    folder.refuses(kitti, &["split val", "val.txt"]);
    assert!(!folder.path("made").exists());
}
