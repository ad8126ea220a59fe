//! The halo's passes against those of every cell, and gradients against finite differences. (`parity_tests` compare the
//! forward pass with the inference engine.)

use crate::network::{Chain, Outputs, Pass, StepInput};
use crate::plan::{MapPlan, Plan, Planner};
use crate::{anchors::Anchors, pool::Pool, scan::LabelledObject, testing::assert_slope};
use crate::{batch_targets::BatchTargets, halo::Cells, losses, losses::LossSettings};
use mluc_geometry::{Box3, Random};
use mluc_model::{HeadKind, Manifest, Network};
use std::ops::Range;

const LOSSES: LossSettings =
    LossSettings { prototype_scale: 2.0, variance_weight: 0.05, push_weight: 0.0 };

/// A network of the real one's shape with few channels, on a map of 16 x 20.
pub(crate) fn small() -> Network {
    serde_json::from_str(include_str!("small_network.json")).expect("a network")
}

/// Two frames: points in a corner region, so that most cells are background, and two objects.
pub(crate) fn scans() -> Vec<Vec<[f32; 4]>> {
    let mut random = Random::new(9, &[]);
    let mut around = |x: f64, y: f64, n: usize| -> Vec<[f32; 4]> {
        let ranges = [(-0.4, 0.4), (-0.3, 0.3), (-0.8, 0.4)];
        let mut point = || {
            let [dx, dy, z] = ranges.map(|(low, high)| random.uniform(low, high));
            [(x + dx) as f32, (y + dy) as f32, z as f32, 0.0]
        };
        (0..n).map(|_| point()).collect()
    };
    let scan = |x| [around(x, 0.5, 30), around(5.1, -0.6, 20)].concat();
    [2.0, 3.0].map(scan).into()
}

pub(crate) fn targets(network: &Network) -> BatchTargets {
    let mut manifest = Manifest::untrained("small", network.clone());
    let sizes_m = [[0.9, 0.7, 1.2], [0.6, 0.5, 1.0], [0.8, 0.6, 1.1]];
    let classes = manifest.classes.iter_mut().chain(&mut manifest.generic);
    for (class, size_m) in classes.zip(sizes_m) {
        (class.size_m, class.bottom_z_m) = (size_m, -0.8);
        (class.matched_iou, class.unmatched_iou) = (0.6, 0.45);
    }
    let anchors = Anchors::of(&manifest);
    let object = |class, x, y| {
        let bounds = Box3::new([x, y, -0.2, 0.9, 0.65, 1.2, 0.4]);
        LabelledObject::new(class, bounds, 20)
    };
    let is_open = network.head == HeadKind::Open;
    let frames = [2.0, 3.0].map(|x| {
        let mut objects = vec![object(Some(0), x, 0.5), object(Some(1), 5.1, -0.6)];
        objects.extend(is_open.then(|| object(None, 6.5, 1.5)));
        anchors.assign(&objects)
    });
    let [rows, columns] = network.map_shape();
    let is_sigmoid = network.head == HeadKind::Sigmoid;
    let logits = if is_sigmoid { 2 } else { 1 };
    BatchTargets::new(&frames, rows * columns, anchors.per_cell(), logits)
}

/// The same batch with every cell of the map listed: plain dense layers.
fn dense(network: &Network, plan: &Plan) -> Plan {
    let [rows, columns] = network.map_shape();
    let cells = Cells::from_marks([2, rows, columns], &vec![true; 2 * rows * columns]);
    let cell_of = |(row, z): &(u32, u32)| (plan.map.occupied[*row as usize], *z);
    let scatter: Vec<(u32, u32)> = plan.map.scatter.iter().map(cell_of).collect();
    Plan { map: MapPlan::from_cells(network, cells, &scatter), ..plan.clone() }
}

struct Setup {
    network: Network,
    chain: Chain,
    parameters: Vec<f32>,
    plan: Plan,
    targets: BatchTargets,
}

impl Setup {
    fn new(head: HeadKind) -> Setup {
        let network = Network { head, generic: usize::from(head == HeadKind::Open), ..small() };
        let chain = Chain::new(&network);
        let mut parameters = chain.initial(3, 2.0);
        // Away from the special first values, so that every path carries weight.
        let mut random = Random::new(4, &[]);
        parameters.iter_mut().for_each(|p| *p += 0.1 * random.normal() as f32);
        Setup {
            plan: Planner::new(&network).plan(&scans()),
            targets: targets(&network),
            network,
            chain,
            parameters,
        }
    }

    fn run(&self, plan: &Plan, parameters: &[f32]) -> (f64, Pass, Outputs) {
        let input = StepInput::new(parameters, plan, &self.targets.labelled);
        let pass = self.chain.forward(&input, &mut Pool::default());
        let (losses, gradients) =
            losses::evaluate(&pass.outputs, &plan.map, &self.targets, LOSSES, 2);
        (losses.total(), pass, gradients)
    }

    fn gradients(&self, plan: &Plan, pass: &Pass, outputs: &Outputs) -> Vec<f32> {
        let mut pool = Pool::new(self.chain.parameters);
        let input = StepInput::new(&self.parameters, plan, &self.targets.labelled);
        self.chain.backward(&input, pass, outputs, &mut pool);
        pool.gradients
    }
}

#[test]
fn halo_training_equals_dense_training() {
    let s = Setup::new(HeadKind::Metric);
    let full = dense(&s.network, &s.plan);
    let multiplicity = |plan: &Plan| plan.map.block1[1].tail.multiplicity;
    assert!(multiplicity(&s.plan) > 300, "{}", multiplicity(&s.plan));
    assert_eq!(multiplicity(&full), 0);
    let (loss, pass, outputs) = s.run(&s.plan, &s.parameters);
    let (full_loss, full_pass, full_outputs) = s.run(&full, &s.parameters);
    assert!((loss - full_loss).abs() < 1e-5 * loss, "{loss} {full_loss}");
    let near = |a: &[f32], b: &[f32], most: f32| {
        let pairs = a.iter().zip(b);
        pairs.for_each(|(a, b)| assert!((a - b).abs() < most.max(most * b.abs()), "{a} {b}"));
    };
    for (a, b) in pass.statistics().zip(full_pass.statistics()) {
        assert_eq!(a.count, b.count);
        near(&a.mean, &b.mean, 1e-5);
        near(&a.var, &b.var, 1e-5);
    }
    let (found, expected) = (&pass.outputs, &full_pass.outputs);
    near(&found.boxes, &expected.boxes, 1e-4);
    near(&found.embedding, &expected.embedding, 1e-4);
    let halo = s.gradients(&s.plan, &pass, &outputs);
    let plain = s.gradients(&full, &full_pass, &full_outputs);
    let most = plain.iter().fold(0.0f32, |m, g| m.max(g.abs()));
    for (i, (a, b)) in halo.iter().zip(&plain).enumerate() {
        let limit = 1e-4 * most.max(b.abs());
        assert!((a - b).abs() < limit, "parameter {i}: {a} {b}");
    }
}

/// Directional derivatives of each layer's parameters: along the gradient the slope is its norm.
#[test]
fn gradients_are_those_of_the_loss() {
    for head in [HeadKind::Metric, HeadKind::Sigmoid, HeadKind::Open] {
        let s = Setup::new(head);
        let (_, pass, outputs) = s.run(&s.plan, &s.parameters);
        let analytic = s.gradients(&s.plan, &pass, &outputs);
        let mut ranges: Vec<(String, Range<usize>)> = vec![];
        for l in s.chain.layers() {
            ranges.push((format!("{} weight", l.name), l.weight.clone()));
            ranges.push((format!("{} gamma", l.name), l.gamma.clone()));
            ranges.push((format!("{} beta", l.name), l.beta.clone()));
        }
        let heads = s.chain.heads.all();
        ranges.extend(heads.map(|h| (h.name.clone(), h.weight.start..h.bias.end)));
        for (name, range) in ranges {
            let gradient = &analytic[range.clone()];
            let norm = gradient.iter().map(|g| g * g).sum::<f32>().sqrt();
            assert_slope(&name, 1.0, 5e-3, |h| {
                let mut p = s.parameters.clone();
                p[range.clone()].iter_mut().zip(gradient).for_each(|(p, g)| *p += h / norm * g);
                s.run(&s.plan, &p).0 / f64::from(norm)
            });
        }
    }
}
