//! The trainer's network against the inference engine that reads its model file.

use mluc_backbone::Backbone;
use mluc_head::Head;
use mluc_model::{Grid, Manifest, Model, Network, model_bytes};

use super::export;
use super::layers::Pool;
use super::network::Chain;
use super::norm::Statistics;
use super::plan::Planner;
use super::random::Random;

/// The compact network on a smaller range, and a scan in it.
fn scene() -> (Network, Vec<[f32; 4]>) {
    let grid = Grid {
        range_min_m: [0.0, -6.4, -3.0],
        range_max_m: [19.2, 6.4, 1.0],
        ..Grid::kitti_compact()
    };
    let mut random = Random::new(11, &[]);
    let points = (0..3000).map(|_| {
        let at = [
            random.uniform(4.0, 9.0),
            random.uniform(-3.0, 2.0),
            random.uniform(-2.0, 0.0),
        ];
        [at[0] as f32, at[1] as f32, at[2] as f32, 0.5]
    });
    (Network::compact(grid, 3), points.collect())
}

#[test]
fn the_engine_computes_what_was_trained() {
    let (network, points) = scene();
    let chain = Chain::new(&network);
    let mut random = Random::new(12, &[]);
    let mut parameters = chain.initial(1, 3.0);
    for layer in chain.layers() {
        for range in [layer.gamma.clone(), layer.beta.clone()] {
            parameters[range]
                .iter_mut()
                .for_each(|p| *p += 0.2 * random.normal() as f32);
        }
    }
    let plan = Planner::new(&network, false).plan(std::slice::from_ref(&points));
    let cells = plan.map.cells() as u32;
    let everything: Vec<u32> = (0..cells).collect();
    // Statistics of this very scan, as training would keep them.
    let batch = chain.forward(&parameters, &plan, &everything, None, &mut Pool::default());
    let running: Vec<Statistics> = chain.statistics(&batch).cloned().collect();
    let pass = chain.forward(
        &parameters,
        &plan,
        &everything,
        Some(&running),
        &mut Pool::default(),
    );

    let manifest = Manifest {
        uses_intensity: false,
        ..Manifest::untrained("kitti", network.clone())
    };
    let manifest = export::finish(manifest, &chain, &parameters, &running);
    let bytes =
        model_bytes(&manifest, &export::weights(&chain, &parameters, &running)).expect("a model");
    let model = Model::from_bytes(&bytes).expect("read back");
    let mut backbone = Backbone::new(&model.manifest, &model.weights).expect("an engine");
    let head = Head::new(&model.manifest, &model.weights).expect("a head");
    let frame = backbone.run(&points);
    let (mut at, mut rows) = (
        vec![0; frame.rows],
        vec![0.0; frame.rows * network.feature_channels()],
    );
    backbone.write_rows(&mut at, &mut rows).expect("written");
    let outputs = head.outputs(&rows);
    let [objectness, embedding, boxes, direction] = &outputs[..] else {
        panic!("{} heads", outputs.len());
    };
    assert!(frame.rows > 500);
    let mut most = 0.0f32;
    for (row, &cell) in at.iter().enumerate() {
        let cell = cell as usize;
        let (up1, up2) = (
            plan.map.up1_row[cell] as usize,
            plan.map.up2_row[cell] as usize,
        );
        for a in 0..6 {
            let ours = pass.presence[0][up1 * 6 + a] + pass.presence[1][up2 * 6 + a];
            most = most.max((ours - objectness[row * 6 + a]).abs());
        }
        for (ours, theirs, width) in [
            (&pass.embedding, embedding, 3),
            (&pass.boxes, boxes, 42),
            (&pass.direction, direction, 12),
        ] {
            for c in 0..width {
                most = most.max((ours[cell * width + c] - theirs[row * width + c]).abs());
            }
        }
    }
    assert!(most < 1e-4, "{most}");
    let empty = head.objectness_max(&backbone.empty_rows().expect("rows"));
    assert!(
        (empty - manifest.empty_objectness_max).abs() < 1e-4,
        "{empty}"
    );
}

/// Anchors, codes and direction bins mean the same to the trainer and to the head.
#[test]
fn the_head_reads_the_codes_that_training_aims_at() {
    use super::scene::Object;
    use super::targets::Anchors;
    let manifest = Manifest::untrained("kitti", scene().0);
    let ours = Anchors::of(&manifest);
    let theirs = mluc_head::decode::Anchors::new(&manifest);
    for yaw in [-3.0, -1.2, 0.2, 1.4, 2.7] {
        let bounds = mluc_geometry::Box3::new([9.3, 1.1, -1.0, 4.1, 1.7, 1.5, yaw]);
        let object = Object {
            class: Some(0),
            bounds,
            points: 50,
            made_up: false,
        };
        let positives = ours.assign(&[object]).positives;
        assert!(!positives.is_empty());
        for p in positives {
            let anchor = theirs.anchor(p.cell as usize, p.anchor as usize);
            let found = mluc_head::decode::decode(&p.codes, &anchor).expect("a box");
            let found_yaw = mluc_head::decode::direct(found.yaw_rad, usize::from(p.bin));
            let turn = mluc_geometry::limit_period(found_yaw - yaw, 0.5, std::f64::consts::TAU);
            assert!(turn.abs() < 1e-5, "{yaw}: {found_yaw}");
            let pairs = found
                .center_m
                .iter()
                .zip(bounds.center_m)
                .chain(found.size_m.iter().zip(bounds.size_m));
            pairs.for_each(|(a, b)| assert!((a - b).abs() < 1e-5, "{a} {b}"));
        }
    }
}
