//! An accuracy floor: the shipped models on the labelled scans of this checkout, through backbone, head and refiner. The
//! scans are few and simulated: the figures say that nothing broke, not how good a model is.

use std::collections::BTreeMap;
use std::path::Path;

use mluc_backbone::Precision;
use mluc_evaluate::NeighbourPolicy;
use mluc_evaluate::pipeline::{FrameSet, detect_frames, judge, unknown_classes};
use mluc_ingest::unpack;
use mluc_model::Model;
use mluc_refiner::Settings;
use mluc_tests::{NO_CAMERA, root, write_file};

/// Average precision and recall in %, at the model's own threshold, in 3-D, moderate.
type Figures = BTreeMap<String, [f64; 2]>;

/// `accuracy.toml`: of every shipped model.
fn floors() -> BTreeMap<String, Figures> {
    let floors: BTreeMap<String, Figures> =
        toml::from_str(include_str!("accuracy.toml")).expect("floors");
    assert!(
        floors
            .keys()
            .eq(["any-open", "kitti", "kitti-open", "udi", "udi-open"])
    );
    floors
}

fn model(name: &str) -> Model {
    Model::read(&root().join(format!("weights/{name}.safetensors"))).expect("a shipped model")
}

/// The labelled scans of a setting as a KITTI folder.
fn scans(setting: &str, folder: &Path) -> FrameSet {
    let (assets, calibration) = match setting {
        "kitti" => {
            let assets = root().join("tests/assets/kitti");
            let calibration = std::fs::read_to_string(assets.join("calibration"));
            (assets, calibration.expect("a calibration"))
        }
        _ => (root().join("services/mluc/assets"), NO_CAMERA.to_string()),
    };
    let write = |inner: &str, bytes: &[u8]| write_file(&folder.join(inner), bytes);
    for entry in std::fs::read_dir(assets).expect("assets").flatten() {
        let path = entry.path();
        if path.extension().is_some_and(|kind| kind == "scan") {
            let name = path.file_stem().expect("a name").to_string_lossy();
            let read = |path: &Path| std::fs::read(path).expect("an asset");
            let points = unpack(&read(&path)).expect("a packed scan");
            let labels = read(&path.with_extension("txt"));
            let scan = bytemuck::cast_slice(&points);
            write(&format!("velodyne/{name}.bin"), scan);
            write(&format!("label_2/{name}.txt"), &labels);
            write(&format!("calib/{name}.txt"), calibration.as_bytes());
        }
    }
    FrameSet::open(folder, None, usize::MAX).expect("labelled frames")
}

/// What a model reaches, its boxes moved by `shift_m` along x.
fn figures(name: &str, model: &Model, shift_m: f32) -> Figures {
    let folder = tempfile::tempdir().expect("a folder");
    let setting = name.trim_end_matches("-open");
    let set = scans(setting, folder.path());
    let mut frames =
        detect_frames(Precision::default(), model, &set, || ()).expect("the model fits");
    for detection in frames.iter_mut().flat_map(|frame| &mut frame.detections) {
        detection.center_m[0] += shift_m;
    }
    let (unknown, settings) = (unknown_classes(setting), Settings::default());
    let policy = NeighbourPolicy::Official;
    let judged = judge(model, &set, &frames, &unknown, policy, &settings).expect("figures");
    let classes = judged.gated.classes.iter().map(|class| {
        let entry = class.main();
        let figures = [entry.ap.all, entry.recall_percent];
        (class.rule.name.clone(), figures)
    });
    classes.collect()
}

/// The classes that lie below the floor.
fn below(floor: &Figures, figures: &Figures) -> Vec<String> {
    let is_low = |(class, floor): &(&String, &[f64; 2])| {
        let found = figures.get(*class).unwrap_or(&[0.0; 2]);
        found.iter().zip(*floor).any(|(found, floor)| found < floor)
    };
    let low = floor.iter().filter(is_low);
    low.map(|(class, _)| class.clone()).collect()
}

#[test]
fn shipped_models_keep_their_accuracy() {
    for (name, floor) in &floors() {
        let figures = figures(name, &model(name), 0.0);
        println!("{name}: {figures:.1?}");
        assert_eq!(below(floor, &figures), [""; 0], "{name}: {figures:.1?}");
    }
}

/// The floor is not so low that a fault passes: boxes that lie half a metre off, and a weight of the network's first
/// layers lost.
#[test]
fn a_broken_decoder_or_weight_falls_below_the_floor() {
    for (name, floor) in &floors() {
        let sound = model(name);
        let shifted = figures(name, &sound, 0.5);
        assert!(!below(floor, &shifted).is_empty(), "{name}: {shifted:.1?}");
        let mut broken = sound;
        let weight = broken.weights.find_mut("backbone2d.block1.0.weight");
        weight.expect("every network has it").data.reverse();
        let broken = figures(name, &broken, 0.0);
        assert!(!below(floor, &broken).is_empty(), "{name}: {broken:.1?}");
    }
}
