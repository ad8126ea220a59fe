//! The trainer's network against the inference engine that reads its model file.

use crate::{export, losses::LossSettings, network::StepInput, plan::Planner};
use crate::{optimizer::Schedule, pool::Pool, trainer::Trainer};
use mluc_backbone::Backbone;
use mluc_geometry::Random;
use mluc_head::Head;
use mluc_model::{Grid, Manifest, Model, Network, model_bytes};

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
    let losses = LossSettings { prototype_scale: 3.0, ..LossSettings::default() };
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

    let manifest =
        Manifest { uses_intensity: false, ..Manifest::untrained("kitti", network.clone()) };
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
