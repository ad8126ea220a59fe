//! The trainer's network against the inference engine that reads its model file.

use std::f64::consts::TAU;

use mluc_backbone::Backbone;
use mluc_geometry::{Box3, Random, limit_period};
use mluc_head::{Head, decode};
use mluc_model::{Grid, Manifest, Model, Network, model_bytes};

use crate::{anchors::Anchors, export, losses::LossSettings, network::StepInput, plan::Planner};
use crate::{optimizer::Schedule, pool::Pool, scan::LabelledObject, trainer::Trainer};

/// The compact network on a smaller range, and a scan in it.
fn setup() -> (Network, Vec<[f32; 4]>) {
    let grid = Grid::kitti_compact().within([0.0, 19.2], [-6.4, 6.4]);
    let mut random = Random::new(11, &[]);
    let points = (0..3000).map(|_| {
        let ranges = [(4.0, 9.0), (-3.0, 2.0), (-2.0, 0.0)];
        let [x, y, z] = ranges.map(|(low, high)| random.uniform(low, high) as f32);
        [x, y, z, 0.5]
    });
    (Network::compact(grid, 3), points.collect())
}

#[test]
fn the_engine_computes_what_was_trained() {
    let (network, points) = setup();
    let losses = LossSettings {
        prototype_scale: 3.0,
        ..LossSettings::default()
    };
    let trainer = Trainer::new(&network, Schedule::new(1e-3, 1), losses, 1);
    let (chain, mut state) = (trainer.chain, trainer.state);
    let mut random = Random::new(12, &[]);
    for layer in chain.layers() {
        let affine = state.parameters[layer.gamma.start..layer.beta.end].iter_mut();
        affine.for_each(|p| *p += 0.2 * random.normal() as f32);
    }
    let plan = Planner::new(&network).plan(std::slice::from_ref(&points));
    let all: Vec<u32> = (0..plan.map.cells() as u32).collect();
    let mut pool = Pool::default();
    // Statistics of this very scan, as training would keep them.
    let input = StepInput::new(&state.parameters, &plan, &all);
    let batch = chain.forward(&input, &mut pool);
    state.running = batch.statistics().cloned().collect();
    let running = Some(&state.running);
    let pass = chain.forward(&StepInput { running, ..input }, &mut pool);

    let manifest = Manifest {
        uses_intensity: false,
        ..Manifest::untrained("kitti", network.clone())
    };
    let bytes = model_bytes(&manifest, &export::weights(&chain, &state)).expect("a model");
    let model = Model::from_bytes(&bytes).expect("read back");
    let mut backbone = Backbone::new(&model.manifest, &model.weights).expect("an engine");
    let head = Head::new(&model.manifest, &model.weights).expect("a head");
    backbone.run(&points);
    let (cells, rows) = backbone.last_rows().expect("rows");
    let outputs = head.outputs(&rows);
    let [objectness, embedding, boxes, direction] = &outputs[..] else {
        panic!("{} heads", outputs.len());
    };
    assert!(cells.len() > 500);
    let ours = &pass.outputs;
    let by_cell = [
        (&ours.embedding, embedding, 3),
        (&ours.boxes, boxes, 42),
        (&ours.direction, direction, 12),
    ];
    let near = |ours: f32, theirs: f32| assert!((ours - theirs).abs() < 1e-4, "{ours} {theirs}");
    for (row, &cell) in cells.iter().enumerate() {
        let cell = cell as usize;
        let [row1, row2] = plan.map.up_rows(cell);
        for a in 0..6 {
            let [up1, up2] = &ours.presence;
            let sum = up1[row1 * 6 + a] + up2[row2 * 6 + a];
            near(sum, objectness[row * 6 + a]);
        }
        for (ours, theirs, width) in by_cell {
            for c in 0..width {
                near(ours[cell * width + c], theirs[row * width + c]);
            }
        }
    }
}

/// Codes and direction bins mean the same to the trainer and to the head.
#[test]
fn the_head_reads_the_codes_that_training_aims_at() {
    let manifest = Manifest::untrained("kitti", setup().0);
    let ours = Anchors::of(&manifest);
    for yaw in [-3.0, -1.2, 0.2, 1.4, 2.7] {
        let bounds = Box3::new([9.3, 1.1, -1.0, 4.1, 1.7, 1.5, yaw]);
        let object = LabelledObject::new(Some(0), bounds, 50);
        let positives = ours.assign(&[object]).positives;
        assert!(!positives.is_empty());
        for p in positives {
            let anchor = ours.boxes.anchor(p.cell as usize, p.anchor as usize);
            let found = decode::decode(&p.codes, &anchor).expect("a box");
            let found_yaw = decode::direct(found.yaw_rad, usize::from(p.bin));
            let turn = limit_period(found_yaw - yaw, 0.5, TAU);
            assert!(turn.abs() < 1e-5, "{yaw}: {found_yaw}");
            for i in 0..3 {
                assert!((found.center_m[i] - bounds.center_m[i]).abs() < 1e-5);
                assert!((found.size_m[i] - bounds.size_m[i]).abs() < 1e-5);
            }
        }
    }
}
