//! Training a tiny network: it learns, refuses what is no checkpoint of its own, and does not depend on threads.

use crate::network_tests::{scans, small, targets};
use crate::{checkpoint, export, import, layers::Linear, plan::Planner, trainer::Trainer};
use crate::{loader::Batch, losses::LossSettings, optimizer::Schedule};
use mluc_model::{Grid, HeadKind, Manifest, Network};
use std::path::Path;

fn batch(step: u64) -> Batch {
    let network = small();
    let mut scans = scans();
    // Another scan each step: a resumed run must see the same ones.
    for (number, point) in scans.iter_mut().flatten().enumerate() {
        point[0] += 0.02 * ((step as usize * 7 + number) % 5) as f32;
    }
    Batch { plan: Planner::new(&network).plan(&scans), targets: targets(&network) }
}

fn trainer_of(network: &Network, steps: u64, prototype_scale: f32, seed: u64) -> Trainer {
    let losses = LossSettings { prototype_scale, variance_weight: 0.01, ..LossSettings::default() };
    Trainer::new(network, Schedule::new(3e-3, steps), losses, seed)
}

fn trainer(steps: u64) -> Trainer {
    trainer_of(&small(), steps, 2.0, 5)
}

fn train(trainer: &mut Trainer, steps: std::ops::Range<u64>) -> Vec<f64> {
    let step = |step| trainer.step(&batch(step)).expect("a number").losses.total();
    steps.map(step).collect()
}

#[test]
fn the_loss_falls() {
    for bf16 in [false, true] {
        let mut trainer = trainer(300);
        let chain = &mut trainer.chain;
        chain.sparse.iter_mut().chain(&mut chain.block1).for_each(|layer| layer.bf16 = bf16);
        let losses = train(&mut trainer, 0..300);
        let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
        let (first, last) = (mean(&losses[..10]), mean(&losses[290..]));
        assert!(last < 0.2 * first, "{first} to {last}, bf16 {bf16}");
    }
}

#[test]
fn a_wrong_checkpoint_is_refused_and_the_state_left_alone() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("checkpoint.safetensors");
    let mut t = trainer(5);
    let good = t.state.clone();
    let mut fault = |fingerprint: &str| {
        let fault = checkpoint::load(&path, &mut t.state, fingerprint).expect_err("refused");
        assert_eq!(t.state, good);
        fault.to_string()
    };
    // Of another run.
    checkpoint::save(&path, &good, "seed 1").expect("saved");
    let text = fault("seed 2");
    assert!(text.contains("seed 1") && text.contains("seed 2"), "{text}");
    // Cut short.
    let bytes = std::fs::read(&path).expect("read");
    std::fs::write(&path, &bytes[..bytes.len() / 2]).expect("written");
    fault("seed 1");
    // Of another network.
    let head = HeadKind::Sigmoid;
    let larger = trainer_of(&Network { head, ..small() }, 5, 0.0, 1);
    checkpoint::save(&path, &larger.state, "seed 1").expect("saved");
    let text = fault("seed 1");
    assert!(text.contains("`parameters` must have shape"), "{text}");
    // With values that are no numbers.
    let mut broken = good.clone();
    broken.parameters[3] = f32::NAN;
    checkpoint::save(&path, &broken, "seed 1").expect("saved");
    let text = fault("seed 1");
    let expected = "finite values in parameters, found NaN";
    assert!(text.contains(expected), "{text}");
}

fn write_model(t: &Trainer, manifest: &Manifest, path: &Path) {
    let weights = export::weights(&t.chain, &t.state);
    let mut manifest = manifest.clone();
    let most = export::empty_objectness_max(&manifest, &weights);
    manifest.empty_objectness_max = most.expect("an engine");
    let bytes = mluc_model::model_bytes(&manifest, &weights).expect("a model");
    std::fs::write(path, bytes).expect("written");
}

/// A compact network on a small range, which a model file can hold.
fn fresh(head: HeadKind, classes: usize, seed: u64) -> (Trainer, Manifest) {
    let grid = Grid::kitti_compact().within([0.0, 6.4], [-3.2, 3.2]);
    let network = Network {
        head,
        generic: 2 * usize::from(head == HeadKind::Open),
        ..Network::compact(grid, classes)
    };
    let manifest = Manifest::untrained("kitti", network.clone());
    let trainer = trainer_of(&network, 5, manifest.prototype_scale, seed);
    (trainer, manifest)
}

#[test]
fn a_run_starts_from_another_networks_weights_where_they_fit() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("model.safetensors");
    let (base, manifest) = fresh(HeadKind::Metric, 3, 1);
    write_model(&base, &manifest, &path);
    // Of the same kind: everything, bit for bit.
    let (mut same, _) = fresh(HeadKind::Metric, 3, 2);
    assert_ne!(same.state.parameters, base.state.parameters);
    let said = import::start_from(folder.path(), &manifest, &mut same).expect("taken");
    assert_eq!(same.state.parameters, base.state.parameters);
    assert!(said.contains("fresh: nothing"), "{said}");
    // An open head: the classes' anchors, and the embedding scaled so that 2 T f stays.
    let (mut open, mut to) = fresh(HeadKind::Open, 3, 2);
    to.prototype_scale = 2.0;
    let said = import::start_from(&path, &to, &mut open).expect("taken");
    for fresh in ["4 of 10 rows of head.objectness", "head.unknown"] {
        assert!(said.contains(fresh), "{said}");
    }
    let bias = |t: &Trainer, head: &Linear| t.state.parameters[head.bias.clone()].to_vec();
    let boxes = [&base, &open].map(|t| bias(t, &t.chain.heads.boxes));
    assert_eq!(boxes[1][..42], boxes[0]);
    let embedding = |t: &Trainer| bias(t, t.chain.heads.embedding.as_ref().expect("a head"));
    for (old, new) in embedding(&base).iter().zip(&embedding(&open)) {
        assert!((old * 3.0 - new * 2.0).abs() < 1e-6, "{old} {new}");
    }
    // A sigmoid head of more classes: an anchor's own class takes the objectness.
    let (mut sigmoid, to) = fresh(HeadKind::Sigmoid, 4, 2);
    import::start_from(&path, &to, &mut sigmoid).expect("taken");
    let weight = |t: &Trainer, column: usize| {
        let head = &t.chain.heads.presence;
        t.state.parameters[head.weight.start + 5 * head.cout + column]
    };
    assert_eq!(weight(&sigmoid, 2 * 4 + 1), weight(&base, 2));
}

#[test]
fn one_thread_or_two_give_the_same_bits() {
    let run = |threads| {
        let builder = rayon::ThreadPoolBuilder::new().num_threads(threads);
        builder.build().expect("threads").install(|| {
            let mut t = trainer(6);
            train(&mut t, 0..6);
            t.state.parameters.iter().map(|p| p.to_bits()).collect::<Vec<u32>>()
        })
    };
    assert_eq!(run(1), run(2));
}
