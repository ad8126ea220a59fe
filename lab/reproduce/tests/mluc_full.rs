//! The method `mluc-full` equals the product: the head at its own threshold and the refiner with the layers of the model.

use mluc_backbone::{Backbone, Precision};
use mluc_evaluate::SensorDetection;
use mluc_evaluate::pipeline::{FrameSet, ModelGate, detect_frames};
use mluc_head::{Detection, Head};
use mluc_ipc_types::ObjectKind;
use mluc_model::{CLUSTER_SCORER, CLUSTER_SCORER_VALUES, Grid, HeadKind, Manifest};
use mluc_model::{Model, Network, formula_uniform, formula_weights, model_bytes};
use mluc_refiner::{Refiner, RefinerOutput, Settings};
use mluc_reproduce::methods::{Method, MethodInput, run_method};
use mluc_simulate::{ExportOptions, Family, Split, export};
use std::path::Path;

fn scans(folder: &Path) -> FrameSet {
    let options = ExportOptions::new(Family::SimUdi, Split::Val, 4, 5, folder.to_owned());
    export(&options, || ()).expect("simulated scans");
    FrameSet::open(folder, None, usize::MAX).expect("frames")
}

/// An open head with weights by formula on a small map, and arbitrary layers that judge clusters.
fn model() -> Model {
    let grid = Grid::udi().within([-25.6, 25.6], [-25.6, 25.6]);
    let network = Network {
        head: HeadKind::Open,
        generic: Manifest::GENERIC_ANCHORS,
        ..Network::compact(grid, 4)
    };
    let mut manifest = Manifest::untrained("udi", network);
    manifest.thresholds.candidates_max = 300;
    let mut weights = formula_weights(&manifest.network);
    let looks = (0..CLUSTER_SCORER_VALUES).map(|i| formula_uniform(CLUSTER_SCORER, i) as f32 - 0.5);
    weights.insert(CLUSTER_SCORER, vec![CLUSTER_SCORER_VALUES], looks.collect());
    let bytes = model_bytes(&manifest, &weights).expect("a model");
    Model::from_bytes(&bytes).expect("a model")
}

/// Runs scan by scan, as the stages do.
fn product(model: &Model, set: &FrameSet) -> Vec<Vec<SensorDetection>> {
    let mut backbone = Backbone::new(&model.manifest, &model.weights).expect("a model");
    let mut head = Head::new(&model.manifest, &model.weights).expect("a model");
    let mut refiner = Refiner::for_model(Settings::default(), model).expect("a model");
    let mut refined = RefinerOutput::default();
    let classes = model.manifest.class_names();
    let mut one = |index: usize| {
        let points = set.points(index).expect("points");
        backbone.run(bytemuck::cast_slice(&points));
        let (cells, rows) = backbone.last_rows().expect("rows");
        let mut detections: Vec<Detection> = Vec::new();
        head.run(&cells, &rows, &mut detections).expect("boxes");
        refiner.refine(index as u64, &points, &detections, &mut refined);
        SensorDetection::published(&refined, &classes)
    };
    (0..set.names().len()).map(&mut one).collect()
}

#[test]
fn the_method_at_the_models_threshold_is_the_products_pipeline() {
    let folder = tempfile::tempdir().expect("a folder");
    let set = scans(folder.path());
    let mut model = model();
    let refused = Method::Naive.check(&model).expect_err("another head");
    let words = "naive: expected a model with a Softmax head, found a Open head";
    assert!(refused.to_string().contains(words), "{refused}");
    let gate = ModelGate::of(&model);
    let frames = detect_frames(Precision::default(), &model, &set, || ()).expect("boxes");
    let values = gate.thresholds(&frames, 1000);
    assert!(values.len() > 20, "{} doubted boxes", values.len());
    for threshold in [0.0, values[values.len() / 2], values[values.len() - 1]] {
        gate.set(&mut model.manifest.thresholds, threshold as f32);
        let asked = [threshold];
        let input = MethodInput { asked: Some(&asked), ..MethodInput::new(&model, &set, &frames) };
        let output = run_method(Method::MlucFull, &input).expect("objects");
        let found = product(&model, &set);
        let unknown = found.iter().flatten().filter(|o| o.kind == ObjectKind::Unknown);
        assert_eq!(unknown.count() > 0, threshold > 0.0);
        for (lab, product) in output.objects.iter().zip(&found) {
            assert_eq!(lab[0], *product);
        }
    }
}
