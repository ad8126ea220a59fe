//! A recorded benchmark in the trainer's form: a folder that the test writes, and the real scans if `MLUC_KITTI` is set.

use mluc_dataset::{Dataset, PrepareOptions, Splits, prepare};
use mluc_tests::{data_folder, write_file};
use std::path::{Path, PathBuf};

/// A camera like KITTI's, at the sensor.
const CALIBRATION: &str = "P2: 721.54 0 609.56 0 0 721.54 172.85 0 0 0 1 0\nR0_rect: 1 0 0 0 1 0 0 0 1\n\
    Tr_velo_to_cam: 0 -1 0 0 0 0 -1 0 1 0 0 0\n";
const CAR: &str =
    "Car 0.00 0 0.00 600.00 150.00 700.00 200.00 1.50 1.60 4.00 0.00 1.50 20.00 -1.57\n";
const VAN: &str =
    "Van 0.00 2 0.00 500.00 150.00 600.00 200.00 2.20 1.90 5.00 -6.00 1.50 25.00 -1.57\n";
const TRAM: &str =
    "Tram 0.00 0 0.00 100.00 150.00 300.00 200.00 3.50 2.50 16.00 -9.00 1.50 40.00 -1.57\n";

/// A point in the car, one in the van, one outside the camera's view, one behind the sensor.
const POINTS: [[f32; 4]; 4] = [
    [20.0, 0.0, -1.0, 0.5],
    [25.0, 6.0, -1.0, 0.5],
    [5.0, 30.0, -1.0, 0.5],
    [-20.0, 0.0, -1.0, 0.5],
];

fn benchmark(folder: &Path) -> PathBuf {
    let root = folder.join("object");
    let write = |name: &str, bytes: &[u8]| write_file(&root.join(name), bytes);
    let plane = "# Plane\nWidth 4\nHeight 1\n0 -1 0 1.7\n";
    for (name, labels) in [
        ("000000", CAR.to_owned()),
        ("000001", format!("{CAR}{VAN}")),
        ("000002", format!("{CAR}{TRAM}")),
    ] {
        let scan = bytemuck::cast_slice(&POINTS);
        write(&format!("training/velodyne/{name}.bin"), scan);
        let texts = [labels.as_str(), CALIBRATION, plane];
        for (part, text) in ["label_2", "calib", "planes"].into_iter().zip(texts) {
            write(&format!("training/{part}/{name}.txt"), text.as_bytes());
        }
    }
    write("ImageSets/train.txt", b"000001\n000000\n000002\n");
    write("ImageSets/val.txt", b"000001\n");
    root
}

/// The split `train` of `root`; its lists are in `lists` if that is given.
fn options(root: &Path, lists: Option<&Path>, out: PathBuf) -> PrepareOptions {
    PrepareOptions {
        splits: Splits { root: root.to_owned(), folder: lists.map(Path::to_owned) },
        split: "train".to_owned(),
        drop_unknown: false,
        unknown: vec!["van".to_owned(), "truck".to_owned()],
        out,
    }
}

fn prepared(options: &PrepareOptions) -> Dataset {
    prepare(options, || ()).expect("prepared");
    Dataset::open_split(&options.out, "train").expect("a split")
}

#[test]
fn frames_with_unknown_objects_stay_or_go() {
    let folder = tempfile::tempdir().expect("a folder");
    let root = benchmark(folder.path());
    let classes = |dataset: &Dataset, name: &str| -> Vec<String> {
        dataset.labels(name).expect("labels").into_iter().map(|label| label.class).collect()
    };
    let mut options = options(&root, None, folder.path().join("keep"));
    let kept = prepared(&options);
    assert_eq!(kept.names(), ["000001", "000000", "000002"]);
    assert_eq!(classes(&kept, "000001"), ["Car", "Van"]);
    assert_eq!(kept.scan("000001").expect("a scan"), POINTS[..2]);
    assert!(kept.plane_path("000001").is_file());
    // Trams are neither known nor unknown: ignored.
    assert_eq!(classes(&kept, "000002"), ["Car", "Tram"]);

    options.drop_unknown = true;
    options.out = folder.path().join("drop");
    let dropped = prepared(&options);
    assert_eq!(dropped.names(), ["000000", "000002"]);
    assert!(!options.out.join("velodyne/000001.bin").exists());
}

#[test]
fn nothing_is_written_where_something_is_wrong() {
    let folder = tempfile::tempdir().expect("a folder");
    let root = benchmark(folder.path());
    let out = folder.path().join("out");
    let mut options = options(&root, None, out.clone());
    let fault = |given: &PrepareOptions| prepare(given, || ()).expect_err("a fault").to_string();
    options.split = "trainval".into();
    assert!(fault(&options).starts_with("split trainval: expected the list of its frames"));
    options.split = "train".into();
    let labels = root.join("training/label_2/000002.txt");
    std::fs::write(&labels, CAR.replace("Car", "Auto")).expect("written");
    let told = fault(&options);
    let names_place = told.contains("000002.txt, line 1, field type: expected one of Car, ");
    assert!(names_place && told.ends_with("found 'Auto'"), "{told}");
    std::fs::write(&labels, CAR).expect("written");
    let calibration = root.join("training/calib/000000.txt");
    std::fs::remove_file(&calibration).expect("removed");
    let told = fault(&options);
    assert!(told.starts_with("frame 000000: expected its calibration in "), "{told}");
    std::fs::write(&calibration, CALIBRATION).expect("written");
    assert!(!out.exists());
    std::fs::create_dir(&out).expect("a folder");
    assert!(fault(&options).contains("expected a new folder"));
}

/// On the real frames: the camera sees a sixth of a scan, and every labelled object keeps its points.
#[test]
fn real_scans_keep_the_points_of_labelled_objects() {
    let Some(folder) = data_folder("MLUC_KITTI") else {
        return;
    };
    let root = folder.join("object");
    let original = Dataset::open(&root.join("training")).expect("real scans");
    let lists = tempfile::tempdir().expect("a folder");
    std::fs::write(lists.path().join("train.txt"), original.names().join("\n")).expect("written");
    let out = lists.path().join("keep");
    let kept = prepared(&options(&root, Some(lists.path()), out));
    let count = |dataset: &Dataset, unknown: bool| -> (usize, usize) {
        let (mut inside, mut all) = (0, 0);
        for name in original.names() {
            let scan = dataset.scan(name).expect("a scan");
            all += scan.len();
            for (label, b) in original.boxes_in_sensor(name).expect("labels") {
                let is_unknown = label.is("Van") || label.is("Truck");
                if is_unknown == unknown && label.truncated < 0.01 {
                    inside += b.count_inside(&scan);
                }
            }
        }
        (inside, all)
    };
    let ((before, all), (after, seen)) = (count(&original, false), count(&kept, false));
    println!("points of known objects {after} of {before}, of all {seen} of {all}");
    assert!(after * 100 >= before * 99 && seen * 4 < all);
    assert!(count(&kept, true).0 > 500);
}
