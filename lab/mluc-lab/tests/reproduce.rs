//! `mluc-lab reproduce` on a plan of a minute: everything is simulated, trained, judged and reported; a second run only looks.

use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

const ROWS: &str =
    "closed-set supervised naive osis ml-only uc-only paper paper-corrected mluc-open mluc-full";
const FIGURES: &str = "map_known ap_unknown map_harm recall_unknown ap_unknown_iou25_r11";

fn reproduce(folder: &Path, more: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_mluc-lab"))
        .args(["reproduce", "--setting", "kitti", "--smoke"])
        .args(["--data", "data", "--runs", "runs", "--out", "report"])
        .args(more)
        .current_dir(folder)
        .output()
        .expect("mluc-lab runs")
}

/// What a run said that went well, or did not.
fn said(output: &Output, is_well: bool) -> String {
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.success(), is_well, "{text}");
    text
}

fn report(folder: &Path) -> Value {
    let json = std::fs::read(folder.join("report/report.json")).expect("a report");
    serde_json::from_slice(&json).expect("JSON")
}

#[test]
fn everything_is_made_once_and_what_is_lost_is_made_again_to_the_same_bits() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    said(&reproduce(folder, &[]), true);
    let first = report(folder);
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
    let page = std::fs::read_to_string(folder.join("report/README.md")).expect("a page");
    for part in ["Table 1", "Table 2", "66.8", "figure5.svg"] {
        assert!(page.contains(part), "{part}");
    }
    for picture in [
        "figure5.png",
        "figure6.png",
        "worst-sim-kitti-mluc-full.png",
        "worst-sim-kitti-paper-corrected.png",
    ] {
        let bytes = std::fs::read(folder.join("report").join(picture)).expect("a picture");
        assert!(bytes.starts_with(b"\x89PNG"), "{picture}");
    }

    // One evaluation and a network are lost: both are made again, the rest is left alone.
    let lost = folder.join("runs/sim-kitti");
    std::fs::remove_file(lost.join("evaluations/ml-only.json")).expect("it was there");
    std::fs::remove_dir_all(lost.join("mluc-full")).expect("it was there");
    let told = said(&reproduce(folder, &[]), true);
    assert!(told.contains("train mluc-full"), "{told}");
    assert!(
        !told.contains("train metric") && !told.contains("simulate"),
        "{told}"
    );
    assert_eq!(report(folder), first);
}

#[test]
fn faults_are_told_with_what_was_expected_and_found() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let refused = |words: &str| {
        let told = said(&reproduce(folder, &["--no-train"]), false);
        assert!(told.contains(words), "{told}");
    };
    // Somebody's folder where a split should be.
    let test = folder.join("data/sim-kitti/test");
    std::fs::create_dir_all(&test).expect("a folder");
    std::fs::write(test.join("notes.txt"), "mine").expect("written");
    refused("data/sim-kitti/test: expected a data set of at least 6 frames, found 0");
    assert!(test.join("notes.txt").is_file());
    std::fs::remove_dir_all(&test).expect("removed");

    // No network at all.
    refused("runs: expected a trained network of at least one kind");

    // A model of the other setting.
    let grid = mluc_model::Grid::udi();
    let manifest = mluc_model::Manifest::untrained("udi", mluc_model::Network::compact(grid, 4));
    let weights = mluc_model::formula_weights(&manifest.network);
    let bytes = mluc_model::model_bytes(&manifest, &weights).expect("a model");
    let run = folder.join("runs/sim-kitti/metric");
    std::fs::create_dir_all(&run).expect("a folder");
    std::fs::write(run.join("model.safetensors"), bytes).expect("written");
    refused("expected a model of setting kitti, found udi");
}
