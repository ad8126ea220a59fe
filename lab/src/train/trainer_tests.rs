//! Training a tiny network: it learns, resumes exactly, and does not depend on threads.

use mluc_model::{Grid, HeadKind, Manifest, Network};

use super::checkpoint;
use super::export;
use super::import;
use super::loader::Batch;
use super::losses::MetricSettings;
use super::network_tests::{scans, small, targets};
use super::optimizer::Schedule;
use super::plan::Planner;
use super::trainer::Trainer;

fn batch(step: u64) -> Batch {
    let network = small();
    let mut scans = scans();
    // Another scan each step: a resumed run must see the same ones.
    for (number, point) in scans.iter_mut().flatten().enumerate() {
        point[0] += 0.02 * ((step as usize * 7 + number) % 5) as f32;
    }
    let plan = Planner::new(&network, false).plan(&scans);
    Batch {
        step,
        plan,
        targets: targets(&network),
        seconds: 0.0,
    }
}

fn trainer(steps: u64) -> Trainer {
    let metric = MetricSettings {
        prototype_scale: 2.0,
        variance_weight: 0.01,
        ..MetricSettings::default()
    };
    Trainer::new(
        &small(),
        Schedule {
            rate_max: 3e-3,
            steps,
        },
        metric,
        5,
    )
}

fn train(trainer: &mut Trainer, steps: std::ops::Range<u64>) -> Vec<f64> {
    let step = |step| trainer.step(&batch(step)).expect("a number").losses.total();
    steps.map(step).collect()
}

#[test]
fn the_loss_falls() {
    let losses = train(&mut trainer(300), 0..300);
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    let (first, last) = (mean(&losses[..10]), mean(&losses[290..]));
    assert!(last < 0.2 * first, "{first} to {last}");
}

#[test]
fn a_resumed_run_gives_the_bits_of_an_uninterrupted_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("checkpoint.safetensors");
    let mut whole = trainer(12);
    train(&mut whole, 0..12);
    let mut first = trainer(12);
    assert!(!checkpoint::load(&path, &mut first.state, "same").expect("no file is no fault"));
    train(&mut first, 0..5);
    checkpoint::save(&path, &first.state, "same").expect("saved");
    let mut second = trainer(12);
    assert!(checkpoint::load(&path, &mut second.state, "same").expect("loaded"));
    assert_eq!(second.state.step, 5);
    train(&mut second, 5..12);
    let bits = |t: &Trainer| {
        t.state
            .parameters
            .iter()
            .map(|p| p.to_bits())
            .collect::<Vec<_>>()
    };
    assert_eq!(bits(&whole), bits(&second));
    assert_eq!(whole.state.running, second.state.running);
}

#[test]
fn a_checkpoint_of_another_run_or_cut_short_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("checkpoint.safetensors");
    let mut t = trainer(5);
    checkpoint::save(&path, &t.state, "seed 1").expect("saved");
    let fault = checkpoint::load(&path, &mut t.state, "seed 2")
        .expect_err("refused")
        .to_string();
    assert!(
        fault.contains("seed 1") && fault.contains("seed 2"),
        "{fault}"
    );
    let bytes = std::fs::read(&path).expect("read");
    std::fs::write(&path, &bytes[..bytes.len() / 2]).expect("written");
    assert!(checkpoint::load(&path, &mut t.state, "seed 1").is_err());
}

#[test]
fn a_checkpoint_of_another_network_is_refused_and_the_state_left_alone() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("checkpoint.safetensors");
    let other = Network {
        head: HeadKind::Sigmoid,
        ..small()
    };
    let metric = MetricSettings::default();
    let schedule = Schedule {
        rate_max: 1e-3,
        steps: 5,
    };
    let larger = Trainer::new(&other, schedule, metric, 1);
    checkpoint::save(&path, &larger.state, "same words").expect("saved");
    let mut t = trainer(5);
    let before = t.state.clone();
    let fault = checkpoint::load(&path, &mut t.state, "same words").expect_err("refused");
    assert!(fault.to_string().contains("parameters of"), "{fault}");
    assert_eq!(before, t.state);
}

#[test]
fn a_checkpoint_with_values_that_are_no_numbers_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("checkpoint.safetensors");
    let mut t = trainer(5);
    let good = t.state.clone();
    let mut broken = good.clone();
    broken.parameters[3] = f32::NAN;
    checkpoint::save(&path, &broken, "same").expect("saved");
    let fault = checkpoint::load(&path, &mut t.state, "same").expect_err("refused");
    let text = fault.to_string();
    assert!(
        text.contains("finite values in parameters, found NaN"),
        "{text}"
    );
    assert_eq!(t.state, good);
}

/// A folder that cannot be written to stands for a full disk: the last good checkpoint is not touched before the new one is whole.
#[test]
fn a_failed_write_leaves_the_last_good_checkpoint() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("checkpoint.safetensors");
    let mut t = trainer(6);
    train(&mut t, 0..2);
    checkpoint::save(&path, &t.state, "same").expect("saved");
    let good = t.state.clone();
    train(&mut t, 2..4);
    // Where the new file is to be written stands a folder: the write fails, as on a full disk.
    std::fs::create_dir(crate::whole_file::beside(&path)).expect("a folder");
    let fault = checkpoint::save(&path, &t.state, "same").expect_err("no room");
    assert!(fault.to_string().contains("checkpoint"), "{fault}");
    let mut restored = trainer(6);
    assert!(checkpoint::load(&path, &mut restored.state, "same").expect("the old one"));
    assert_eq!(restored.state, good);
}

fn model_of(t: &Trainer, manifest: &Manifest, path: &std::path::Path) {
    let weights = export::weights(&t.chain, &t.state.parameters, &t.state.running);
    let manifest = export::finish(
        manifest.clone(),
        &t.chain,
        &t.state.parameters,
        &t.state.running,
    );
    std::fs::write(
        path,
        mluc_model::model_bytes(&manifest, &weights).expect("a model"),
    )
    .expect("written");
}

/// A compact network on a small range, which a model file can hold.
fn fresh(head: HeadKind, classes: usize, seed: u64) -> (Trainer, Manifest) {
    let grid = Grid {
        range_min_m: [0.0, -3.2, -3.0],
        range_max_m: [6.4, 3.2, 1.0],
        ..Grid::kitti_compact()
    };
    let network = Network {
        head,
        generic: if head == HeadKind::Open { 2 } else { 0 },
        ..Network::compact(grid, classes)
    };
    let manifest = Manifest::untrained("kitti", network.clone());
    let metric = MetricSettings {
        prototype_scale: manifest.prototype_scale,
        ..MetricSettings::default()
    };
    let schedule = Schedule {
        rate_max: 1e-3,
        steps: 5,
    };
    (Trainer::new(&network, schedule, metric, seed), manifest)
}

#[test]
fn a_run_starts_from_another_networks_weights_where_they_fit() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("model.safetensors");
    let (base, manifest) = fresh(HeadKind::Metric, 3, 1);
    model_of(&base, &manifest, &path);
    // Of the same kind: everything, bit for bit.
    let (mut same, _) = fresh(HeadKind::Metric, 3, 2);
    assert_ne!(same.state.parameters, base.state.parameters);
    let said = import::start_from(folder.path(), &manifest, &mut same).expect("taken");
    assert_eq!(same.state.parameters, base.state.parameters);
    assert!(said.contains("fresh: nothing"), "{said}");
    // An open head: the classes' anchors, and the embedding scaled so that 2 T f stays.
    let (mut open, to) = fresh(HeadKind::Open, 3, 2);
    let to = Manifest {
        prototype_scale: 2.0,
        ..to
    };
    let said = import::start_from(&path, &to, &mut open).expect("taken");
    assert!(
        said.contains("4 of 10 rows of head.objectness") && said.contains("head.unknown"),
        "{said}"
    );
    let bias =
        |t: &Trainer, head: &super::layers::Linear| t.state.parameters[head.bias.clone()].to_vec();
    let (from, into) = (&base.chain.heads, &open.chain.heads);
    assert_eq!(bias(&open, &into.boxes)[..42], bias(&base, &from.boxes)[..]);
    let embeddings = [(&base, from), (&open, into)].map(|(t, heads)| {
        heads
            .embedding
            .as_ref()
            .map(|head| bias(t, head))
            .expect("a head")
    });
    for (old, new) in embeddings[0].iter().zip(&embeddings[1]) {
        assert!((old * 3.0 - new * 2.0).abs() < 1e-6, "{old} {new}");
    }
    // A sigmoid head of more classes: an anchor's own class takes the objectness.
    let (mut sigmoid, to) = fresh(HeadKind::Sigmoid, 4, 2);
    import::start_from(&path, &to, &mut sigmoid).expect("taken");
    let head = &sigmoid.chain.heads.presence;
    let found = sigmoid.state.parameters[head.weight.start + 5 * head.cout + 2 * 4 + 1];
    let head = &base.chain.heads.presence;
    assert_eq!(
        found,
        base.state.parameters[head.weight.start + 5 * head.cout + 2]
    );
}

#[test]
fn one_thread_or_two_give_the_same_bits() {
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads");
        pool.install(|| {
            let mut t = trainer(6);
            train(&mut t, 0..6);
            t.state
                .parameters
                .iter()
                .map(|p| p.to_bits())
                .collect::<Vec<_>>()
        })
    };
    assert_eq!(run(1), run(2));
}

#[test]
fn the_model_file_has_every_tensor_and_the_weights_lie_where_they_belong() {
    let t = trainer(5);
    let chain = &t.chain;
    let set = export::weights(chain, &t.state.parameters, &t.state.running);
    set.check(&chain.network)
        .expect("every tensor, right shapes");
    let p = &t.state.parameters;
    let sparse = &chain.sparse[1];
    let found = &set.find("s1.weight").expect("there").data;
    assert_eq!(
        found[(2 * 27 + 5) * 4 + 3],
        p[sparse.weight.start + (5 * 4 + 3) * 6 + 2]
    );
    let dense = &chain.block2[0];
    let found = &set.find("c0.weight").expect("there").data;
    assert_eq!(
        found[(3 * 6 + 4) * 9 + 7],
        p[dense.weight.start + (7 * 6 + 4) * 7 + 3]
    );
    let up = &chain.up2;
    let found = &set.find("u2.weight").expect("there").data;
    // Input 6, output 1, second row, first column: place 2.
    assert_eq!(
        found[((6 * 3 + 1) * 2 + 1) * 2],
        p[up.weight.start + 6 * 12 + 2 * 3 + 1]
    );
    let head = &chain.heads.boxes;
    let found = &set.find("head.box.weight").expect("there").data;
    assert_eq!(found[9 * 8 + 4], p[head.weight.start + 4 * 28 + 9]);
    let empty = export::empty_objectness_max(chain, p, &t.state.running);
    assert!(empty > 0.0 && empty < 0.5, "{empty}");
}
