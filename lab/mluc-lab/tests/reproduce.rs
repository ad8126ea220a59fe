//! `mluc-lab reproduce` on a plan of a minute: everything is simulated, trained, judged and reported; a second run only looks.

use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

const ROWS: [&str; 10] = [
    "closed-set",
    "supervised",
    "naive",
    "osis",
    "ml-only",
    "uc-only",
    "paper",
    "paper-corrected",
    "mluc-open",
    "mluc-full",
];

fn reproduce(folder: &Path, more: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_mluc-lab"))
        .args(["reproduce", "--setting", "kitti", "--smoke"])
        .args(["--data", "data", "--runs", "runs", "--out", "report"])
        .args(more)
        .current_dir(folder)
        .output()
        .expect("mluc-lab runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn report(folder: &Path) -> Value {
    let json = std::fs::read(folder.join("report/report.json")).expect("a report");
    serde_json::from_slice(&json).expect("JSON")
}

#[test]
fn everything_is_made_once_and_what_is_lost_is_made_again_to_the_same_bits() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let output = reproduce(folder, &[]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let first = report(folder);
    for row in ROWS {
        let figures = &first["sim-kitti"][row];
        for name in [
            "map_known",
            "ap_unknown",
            "map_harm",
            "recall_unknown",
            "ap_unknown_iou25_r11",
        ] {
            let value = figures[name]
                .as_array()
                .unwrap_or_else(|| panic!("{row}: {name}"));
            assert!(
                value.len() == 2 && value.iter().all(|v| v.is_f64()),
                "{row}: {name}"
            );
        }
        assert_eq!(figures["spread"], "bootstrap");
    }
    let networks = first["details"]["sim-kitti"]["networks"]
        .as_array()
        .expect("networks");
    assert_eq!(networks.len(), 7);
    assert!(networks.iter().all(|n| {
        n["command"]
            .as_str()
            .is_some_and(|c| c.starts_with("mluc-lab train"))
    }));
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
    std::fs::remove_file(folder.join("runs/sim-kitti/evaluations/ml-only.json"))
        .expect("it was there");
    std::fs::remove_dir_all(folder.join("runs/sim-kitti/mluc-full")).expect("it was there");
    let output = reproduce(folder, &[]);
    let told = text(&output.stderr);
    assert!(output.status.success(), "{told}");
    assert!(
        told.contains("train mluc-full") && !told.contains("train metric"),
        "{told}"
    );
    assert!(!told.contains("simulate"), "{told}");
    assert_eq!(report(folder), first);
}

#[test]
fn faults_are_told_with_what_was_expected_and_found() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    // Somebody's folder where a split should be.
    let test = folder.join("data/sim-kitti/test");
    std::fs::create_dir_all(&test).expect("a folder");
    std::fs::write(test.join("notes.txt"), "mine").expect("written");
    let output = reproduce(folder, &["--no-train"]);
    let told = text(&output.stderr);
    assert!(!output.status.success());
    assert!(
        told.contains("data/sim-kitti/test: expected a data set of at least 6 frames, found 0"),
        "{told}"
    );
    assert!(test.join("notes.txt").is_file());
    std::fs::remove_dir_all(&test).expect("removed");

    // No network at all.
    let output = reproduce(folder, &["--no-train"]);
    let told = text(&output.stderr);
    assert!(!output.status.success());
    assert!(
        told.contains("runs: expected a trained network of at least one kind"),
        "{told}"
    );

    // A model of the other setting.
    let grid = mluc_model::Grid::udi();
    let manifest = mluc_model::Manifest::untrained("udi", mluc_model::Network::compact(grid, 4));
    let weights = mluc_model::formula_weights(&manifest.network);
    let bytes = mluc_model::model_bytes(&manifest, &weights).expect("a model");
    let run = folder.join("runs/sim-kitti/metric");
    std::fs::create_dir_all(&run).expect("a folder");
    std::fs::write(run.join("model.safetensors"), bytes).expect("written");
    let output = reproduce(folder, &["--no-train"]);
    let told = text(&output.stderr);
    assert!(!output.status.success());
    assert!(
        told.contains("expected a model of setting kitti, found udi"),
        "{told}"
    );
}
