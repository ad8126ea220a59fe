//! Accuracy baselines: the shipped models on the labelled scans of this checkout, through backbone, head and refiner. The
//! scans are few and simulated: the figures show that nothing broke, not how good a model is.

use mluc_backbone::Precision;
use mluc_evaluate::pipeline::{FrameSet, detect_frames, judge, unknown_classes};
use mluc_model::Model;
use mluc_refiner::Settings;
use mluc_tests::{NO_CAMERA, root, write_file};
use std::{collections::BTreeMap, collections::BTreeSet, path::Path};

/// Average precision and recall in %, at the model's own threshold, in 3-D, moderate.
type Figures = BTreeMap<String, [f64; 2]>;

/// `accuracy.toml`: the baselines of every model that the program ships.
fn floors() -> BTreeMap<String, Figures> {
    toml::from_str(include_str!("accuracy.toml")).expect("floors")
}

fn model(name: &str) -> Model {
    Model::read(&root().join(format!("weights/{name}.safetensors"))).expect("a shipped model")
}

/// All labelled scans as one KITTI folder: some all around without a camera, the others only what a camera sees.
fn scans(folder: &Path) -> FrameSet {
    let write = |inner: &str, bytes: &[u8]| write_file(&folder.join(inner), bytes);
    for assets in ["services/mluc/assets", "tests/assets/kitti"].map(|assets| root().join(assets)) {
        let calibration = std::fs::read(assets.join("calibration")).unwrap_or(NO_CAMERA.into());
        for entry in std::fs::read_dir(&assets).expect("assets").flatten() {
            let path = entry.path();
            let file = path.file_name().expect("a name").to_string_lossy();
            if let Some(name) = file.strip_suffix(".bin.zst") {
                let read = |name: &str| std::fs::read(assets.join(name)).expect("an asset");
                let scan = zstd::decode_all(&read(&file)[..]).expect("a packed scan");
                write(&format!("velodyne/{name}.bin"), &scan);
                let labels = read(&format!("{name}.txt"));
                write(&format!("label_2/{name}.txt"), &labels);
                write(&format!("calib/{name}.txt"), &calibration);
            }
        }
    }
    FrameSet::open(folder, None, usize::MAX).expect("labelled frames")
}

/// The figures of a model after its boxes are moved by `shift_m` along x.
fn figures(model: &Model, shift_m: f32) -> Figures {
    let folder = tempfile::tempdir().expect("a folder");
    let set = scans(folder.path());
    let mut frames = detect_frames(Precision::default(), model, &set, || ()).expect("it fits");
    for detection in frames.iter_mut().flat_map(|frame| &mut frame.detections) {
        detection.center_m[0] += shift_m;
    }
    let (unknown, settings) = (unknown_classes("any"), Settings::default());
    let judged = judge(model, &set, &frames, &unknown, &settings).expect("figures");
    let classes = judged.gated.classes.iter().map(|class| {
        let entry = class.main();
        let figures = [entry.ap.all, entry.recall_percent];
        (class.rule.name.clone(), figures)
    });
    classes.collect()
}

/// The classes below the baseline.
fn below(floor: &Figures, figures: &Figures) -> Vec<String> {
    let is_low = |(class, floor): &(&String, &[f64; 2])| {
        let found = figures.get(*class).unwrap_or(&[0.0; 2]);
        found.iter().zip(*floor).any(|(found, floor)| found < floor)
    };
    floor.iter().filter(is_low).map(|(class, _)| class.clone()).collect()
}

#[test]
fn shipped_models_keep_their_accuracy() {
    let floors = floors();
    let files = std::fs::read_dir(root().join("weights")).expect("weights");
    let paths = files.flatten().map(|file| file.path());
    let shipped = paths.filter(|path| path.is_file());
    let shipped: BTreeSet<_> = shipped.map(|path| path.with_extension("")).collect();
    let named = floors.keys().map(|name| root().join("weights").join(name));
    assert_eq!(named.collect::<BTreeSet<_>>(), shipped);
    for (name, floor) in &floors {
        let figures = figures(&model(name), 0.0);
        println!("{name}: {figures:.1?}");
        assert_eq!(below(floor, &figures), [""; 0], "{name}: {figures:.1?}");
    }
}

/// The baseline is high enough to reveal a fault: boxes half a metre off, or a lost weight in the network's first layers.
#[test]
fn a_broken_decoder_or_weight_falls_below_the_floor() {
    for (name, floor) in &floors() {
        let sound = model(name);
        let shifted = figures(&sound, 0.5);
        assert!(!below(floor, &shifted).is_empty(), "{name}: {shifted:.1?}");
        let mut broken = sound;
        let weight = broken.weights.find_mut("backbone2d.block1.0.weight");
        weight.expect("every network has it").data.reverse();
        let broken = figures(&broken, 0.0);
        assert!(!below(floor, &broken).is_empty(), "{name}: {broken:.1?}");
    }
}
