//! The network and the refiner alone, measured by the programs `network` and `refine`.

use mluc_dataset::scan_bytes;
use mluc_refiner::Variant;
use mluc_tests::{NO_CAMERA, car_scan, write_file};
use serde_json::Value;
use std::process::Command;
use tempfile::TempDir;

/// A folder in KITTI's layout with one scan of a labelled car. The camera sees less than the sensor.
fn one_car() -> TempDir {
    let folder = tempfile::tempdir().expect("a writable folder");
    let write = |path: &str, bytes: &[u8]| write_file(&folder.path().join(path), bytes);
    let camera = "720 0 621 0 0 720 187 0 0 0 1 0";
    let calibration = NO_CAMERA.replacen("0 0 0 0 0 0 0 0 0 0 0 0", camera, 1);
    write("velodyne/000000.bin", &scan_bytes(&car_scan(8.0)));
    write("calib/000000.txt", calibration.as_bytes());
    write("label_2/000000.txt", b"Car 0 0 0 0 0 0 0 1.5 1.8 4 0 1.73 10 -1.57");
    folder
}

/// What a program prints for options as on a command line.
#[track_caller]
fn answer(program: &str, options: &str) -> Value {
    let output = Command::new(program).args(options.split(' ')).output().expect("it starts");
    let log = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{log}");
    serde_json::from_slice(&output.stdout).expect("JSON")
}

#[test]
fn the_network_alone_prints_sites_times_and_operations() {
    let folder = one_car();
    let scan = folder.path().join("velodyne/000000.bin");
    let [full, crop] = ["", " --crop"].map(|crop| {
        let options = "--profile compact --precision f32 --threads 1 --rounds 2 --json";
        answer(env!("CARGO_BIN_EXE_network"), &format!("{options}{crop} --scan {}", scan.display()))
    });
    for key in ["ms_p50", "ms_p99"] {
        for part in ["voxelize", "sparse3d", "dense2d", "head", "total"] {
            assert!(crop[key][part].as_f64() > Some(0.0), "{key} {part}: {crop}");
        }
    }
    let [all, seen] = [&full, &crop].map(|report| report["sites"]["voxels"].as_u64());
    assert!(Some(0) < seen && seen < all, "{seen:?} of {all:?} voxels");
    for part in ["sparse3d", "dense2d"] {
        let [gflop, executed, share] = ["gflop", "gflop_executed", "peak_share"]
            .map(|key| full[key][part].as_f64().expect("a number"));
        assert!(0.0 < executed && executed <= gflop, "{part}: {executed} of {gflop}");
        assert!(0.0 < share, "{part}: {share}");
    }
}

#[test]
fn the_refiner_alone_prints_overlaps_and_times_of_each_variant() {
    let folder = one_car();
    for name in Variant::NAMES {
        let options = format!("--dataset {} --refiner {name} --json", folder.path().display());
        let report = answer(env!("CARGO_BIN_EXE_refine"), &options);
        let number = |key: &str| report[key].as_f64().unwrap_or_else(|| panic!("{key}: {report}"));
        assert_eq!(report["refiner"], name);
        assert_eq!([number("objects"), number("proposals")], [1.0, 20.0]);
        assert_eq!(report["by_class"]["Car"]["mean_iou_3d"], report["mean_iou_3d"]);
        let shares = ["share_above_0_1", "share_above_0_3", "share_above_0_5"].map(number);
        assert!(shares.is_sorted_by(|more, less| more >= less), "{shares:?}");
        assert!(0.0 < number("mean_iou_3d") && number("mean_iou_3d") < 1.0, "{report}");
        assert!(0.0 < number("p50_ms") && number("p50_ms") <= number("p99_ms"), "{report}");
    }
}
