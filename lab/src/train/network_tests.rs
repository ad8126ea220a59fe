//! The network's passes against plain dense ones, and its gradients against finite differences.

use mluc_model::{DenseLayer, Grid, HeadKind, Network, SparseLayer, UpLayer};

use super::halo::Cells;
use super::layers::Pool;
use super::losses::{self, BatchTargets, MetricSettings};
use super::network::{Chain, OutputGradients, Pass};
use super::norm::EPSILON;
use super::plan::{MapPlan, Plan, Planner};
use super::random::Random;
use super::scene::Object;
use super::targets::Anchors;

const SETTINGS: MetricSettings = MetricSettings {
    prototype_scale: 2.0,
    variance_weight: 0.05,
    pull_weight: 0.3,
    push_weight: 0.0,
    unknown_weight: 0.7,
};

/// A network of the real one's shape with few channels, on a map of 16 x 20.
pub(crate) fn small() -> Network {
    let sparse = |name: &str, submanifold, kernel, stride, padding, cin, cout| SparseLayer {
        name: name.into(),
        submanifold,
        kernel,
        stride,
        padding,
        cin,
        cout,
    };
    let dense = |name: &str, stride, cin, cout| DenseLayer {
        name: name.into(),
        stride,
        cin,
        cout,
    };
    Network {
        profile: "small".into(),
        grid: Grid {
            range_min_m: [0.0, -3.2, -1.0],
            range_max_m: [8.0, 3.2, 0.8],
            voxel_size_m: [0.2, 0.2, 0.2],
            points_per_voxel_max: 5,
            voxels_max: 5000,
        },
        sparse: vec![
            sparse("s0", true, [3; 3], [1; 3], [1; 3], 4, 4),
            sparse("s1", false, [3; 3], [2; 3], [1; 3], 4, 6),
            sparse("s2", true, [3; 3], [1; 3], [1; 3], 6, 6),
            sparse("s3", false, [3, 1, 1], [2, 1, 1], [0; 3], 6, 5),
        ],
        block1: vec![dense("b0", 1, 10, 6), dense("b1", 1, 6, 6)],
        block2: vec![dense("c0", 2, 6, 7), dense("c1", 1, 7, 7)],
        up1: UpLayer {
            name: "u1".into(),
            factor: 1,
            cin: 6,
            cout: 5,
        },
        up2: UpLayer {
            name: "u2".into(),
            factor: 2,
            cin: 7,
            cout: 3,
        },
        classes: 2,
        head: HeadKind::default(),
        generic: 0,
    }
}

/// Two frames: points in a corner region, so that most cells are background, and two objects.
pub(crate) fn scans() -> Vec<Vec<[f32; 4]>> {
    let mut random = Random::new(9, &[]);
    (0..2)
        .map(|frame| {
            let mut around = |x: f64, y: f64, n: usize| -> Vec<[f32; 4]> {
                (0..n)
                    .map(|_| {
                        let d = [
                            random.uniform(-0.4, 0.4),
                            random.uniform(-0.3, 0.3),
                            random.uniform(-0.8, 0.4),
                        ];
                        [(x + d[0]) as f32, (y + d[1]) as f32, d[2] as f32, 0.0]
                    })
                    .collect()
            };
            [around(2.0 + frame as f64, 0.5, 30), around(5.1, -0.6, 20)].concat()
        })
        .collect()
}

pub(crate) fn targets(network: &Network) -> BatchTargets {
    let class = |name: &str, size_m| mluc_model::AnchorClass {
        name: name.into(),
        size_m,
        bottom_z_m: -0.8,
        matched_iou: 0.6,
        unmatched_iou: 0.45,
    };
    let anchors = Anchors::new(
        network,
        &[class("a", [0.9, 0.7, 1.2]), class("b", [0.6, 0.5, 1.0])],
        &[class("any", [0.8, 0.6, 1.1])][..network.generic],
    );
    let object = |class, x, y| Object {
        class: Some(class),
        bounds: mluc_geometry::Box3::new([x, y, -0.2, 0.9, 0.65, 1.2, 0.4]),
        points: 20,
        made_up: false,
    };
    let made_up = Object {
        class: None,
        made_up: true,
        ..object(0, 6.5, 1.5)
    };
    let open = network.head == HeadKind::Open;
    let frames: Vec<_> = [2.0, 3.0]
        .iter()
        .map(|x| {
            let mut objects = vec![object(0, *x, 0.5), object(1, 5.1, -0.6)];
            objects.extend(open.then(|| made_up.clone()));
            anchors.assign(&objects)
        })
        .collect();
    let [rows, columns] = network.map_shape();
    let logits = if network.head == HeadKind::Sigmoid {
        2
    } else {
        1
    };
    BatchTargets::new(&frames, rows * columns, anchors.per_cell(), logits)
}

/// The same batch with every cell of the map listed: plain dense layers.
fn dense(network: &Network, plan: &Plan) -> Plan {
    let [rows, columns] = network.map_shape();
    let cells = Cells::from_marks([2, rows, columns], &vec![true; 2 * rows * columns]);
    // Undo the row numbers: dense index of each listed row.
    let marked = listed_cells(network);
    let scatter: Vec<(u32, u32)> = plan
        .map
        .scatter
        .iter()
        .map(|(row, z)| (marked[*row as usize], *z))
        .collect();
    Plan {
        sparse: plan.sparse.clone(),
        map: MapPlan::from_cells(network, cells, &scatter),
    }
}

/// Cells of the scattered map, found again from the voxels.
fn listed_cells(network: &Network) -> Vec<u32> {
    let [rows, columns] = network.map_shape();
    let mut marks = std::collections::BTreeSet::new();
    for (frame, scan) in scans().iter().enumerate() {
        let mut voxels = mluc_backbone::Voxels::new(&network.grid);
        mluc_backbone::voxelize(scan, &network.grid, false, &mut voxels);
        let mut books = mluc_backbone::Rulebooks::new(network);
        books.build(network, &voxels.sites);
        for site in books
            .sites_after(network.sparse.len() - 1, &voxels.sites)
            .coordinates()
        {
            let [_, y, x] = site.map(usize::from);
            marks.insert(((frame * rows + y) * columns + x) as u32);
        }
    }
    marks.into_iter().collect()
}

struct Setup {
    network: Network,
    chain: Chain,
    parameters: Vec<f32>,
    plan: Plan,
    targets: BatchTargets,
}

fn setup() -> Setup {
    setup_of(HeadKind::Metric)
}

fn setup_of(head: HeadKind) -> Setup {
    let network = Network {
        head,
        generic: usize::from(head == HeadKind::Open),
        ..small()
    };
    let chain = Chain::new(&network);
    let mut parameters = chain.initial(3, 2.0);
    // Away from the special first values, so that every path carries weight.
    let mut random = Random::new(4, &[]);
    parameters
        .iter_mut()
        .for_each(|p| *p += 0.1 * random.normal() as f32);
    let plan = Planner::new(&network, false).plan(&scans());
    let targets = targets(&network);
    Setup {
        network,
        chain,
        parameters,
        plan,
        targets,
    }
}

fn run(s: &Setup, plan: &Plan, parameters: &[f32]) -> (f64, Pass, OutputGradients) {
    let pass = s.chain.forward(
        parameters,
        plan,
        &s.targets.labelled,
        None,
        &mut Pool::default(),
    );
    let (losses, gradients) = losses::evaluate(&pass, &plan.map, &s.targets, SETTINGS, 2);
    (losses.total(), pass, gradients)
}

fn gradients(s: &Setup, plan: &Plan, pass: &Pass, outputs: &OutputGradients) -> Vec<f32> {
    let mut gradients = vec![0.0; s.chain.parameters];
    let labelled = &s.targets.labelled;
    s.chain.backward(
        &s.parameters,
        plan,
        labelled,
        pass,
        outputs,
        &mut gradients,
        &mut Pool::default(),
    );
    gradients
}

#[test]
fn halo_training_equals_dense_training() {
    let s = setup();
    let full = dense(&s.network, &s.plan);
    assert!(
        s.plan.map.block1[1].multiplicity > 300,
        "{}",
        s.plan.map.block1[1].multiplicity
    );
    assert_eq!(full.map.block1[1].multiplicity, 0);
    let (loss, pass, outputs) = run(&s, &s.plan, &s.parameters);
    let (full_loss, full_pass, full_outputs) = run(&s, &full, &s.parameters);
    assert!((loss - full_loss).abs() < 1e-5 * loss, "{loss} {full_loss}");
    for (a, b) in s
        .chain
        .statistics(&pass)
        .zip(s.chain.statistics(&full_pass))
    {
        assert_eq!(a.count, b.count);
        let pairs = a
            .mean
            .iter()
            .zip(&b.mean)
            .chain(a.variance.iter().zip(&b.variance));
        pairs.for_each(|(a, b)| assert!((a - b).abs() < 1e-5, "{a} {b}"));
    }
    for (a, b) in pass
        .boxes
        .iter()
        .zip(&full_pass.boxes)
        .chain(pass.embedding.iter().zip(&full_pass.embedding))
    {
        assert!((a - b).abs() < 1e-4, "{a} {b}");
    }
    let halo = gradients(&s, &s.plan, &pass, &outputs);
    let plain = gradients(&s, &full, &full_pass, &full_outputs);
    let most = plain.iter().fold(0.0f32, |m, g| m.max(g.abs()));
    for (i, (a, b)) in halo.iter().zip(&plain).enumerate() {
        assert!(
            (a - b).abs() < 1e-4 * most.max(b.abs()),
            "parameter {i}: {a} {b}"
        );
    }
}

/// Directional derivatives of each layer's parameters.
#[test]
fn gradients_are_those_of_the_loss() {
    for head in [HeadKind::Metric, HeadKind::Sigmoid, HeadKind::Open] {
        slopes_agree(&setup_of(head));
    }
}

fn slopes_agree(s: &Setup) {
    let (_, pass, outputs) = run(s, &s.plan, &s.parameters);
    let analytic = gradients(s, &s.plan, &pass, &outputs);
    let mut ranges: Vec<(String, std::ops::Range<usize>)> = vec![];
    for l in s.chain.layers() {
        ranges.push((format!("{} weight", l.name), l.weight.clone()));
        ranges.push((format!("{} gamma", l.name), l.gamma.clone()));
        ranges.push((format!("{} beta", l.name), l.beta.clone()));
    }
    for h in s.chain.heads.all() {
        ranges.push((h.name.clone(), h.weight.start..h.bias.end));
    }
    for (name, range) in ranges {
        let norm = analytic[range.clone()]
            .iter()
            .map(|g| g * g)
            .sum::<f32>()
            .sqrt();
        let at = |h: f32| {
            let mut p = s.parameters.clone();
            p[range.clone()]
                .iter_mut()
                .zip(&analytic[range.clone()])
                .for_each(|(p, g)| *p += h / norm * g);
            run(s, &s.plan, &p).0
        };
        // Along the gradient the slope is its norm. A large step meets ReLU's kinks, a small one rounding: any will do.
        let ratio = |h: f32| (at(h) - at(-h)) / (2.0 * f64::from(h)) / f64::from(norm);
        let ratios = [4e-3, 1e-3, 2e-4, 5e-5].map(ratio);
        assert!(
            ratios.iter().any(|r| (r - 1.0).abs() < 0.01),
            "{name}: {ratios:?} of norm {norm}"
        );
    }
}

/// The map's layers written out cell by cell, without rows or gathers.
#[test]
fn forward_equals_a_plain_dense_network() {
    let s = setup();
    let [rows, columns] = s.network.map_shape();
    let (_, pass, _) = run(&s, &s.plan, &s.parameters);
    let width = s.network.map_channels();
    let mut map = vec![0.0f32; 2 * rows * columns * width];
    for (row, cell) in listed_cells(&s.network).iter().enumerate() {
        map[*cell as usize * width..][..width].copy_from_slice(&pass.map[row * width..][..width]);
    }
    let mut shape = [2, rows, columns];
    let mut x = map;
    let mut features = vec![];
    let blocks = s
        .chain
        .block1
        .iter()
        .zip(&s.network.block1)
        .chain(s.chain.block2.iter().zip(&s.network.block2));
    for (number, (layer, description)) in blocks.enumerate() {
        (x, shape) = plain_convolution(&x, shape, layer, description.stride, &s.parameters);
        if number == 1 {
            features.push((x.clone(), shape));
        }
    }
    features.push((x, shape));
    let up1 = plain_up(&features[0].0, &s.chain.up1, &s.parameters);
    let up2 = plain_up(&features[1].0, &s.chain.up2, &s.parameters);
    let head = &s.chain.heads.presence;
    for cell in 0..2 * rows * columns {
        let (frame, y, column) = (
            cell / (rows * columns),
            cell / columns % rows,
            cell % columns,
        );
        let half = (frame * (rows / 2) + y / 2) * (columns / 2) + column / 2;
        let second = 4 * half + y % 2 * 2 + column % 2;
        let feature = [&up1[cell * 5..][..5], &up2[second * 3..][..3]].concat();
        let weights = &s.parameters[head.weight.clone()];
        for a in 0..4 {
            let logit: f32 = (0..8).map(|c| feature[c] * weights[c * 4 + a]).sum::<f32>()
                + s.parameters[head.bias.clone()][a];
            let (row1, row2) = (
                s.plan.map.up1_row[cell] as usize,
                s.plan.map.up2_row[cell] as usize,
            );
            let found = pass.presence[0][row1 * 4 + a] + pass.presence[1][row2 * 4 + a];
            assert!(
                (found - logit).abs() < 2e-4,
                "cell {cell} anchor {a}: {found} {logit}"
            );
        }
    }
}

fn plain_norm(x: &mut [f32], layer: &super::layers::Layer, parameters: &[f32]) {
    let channels = layer.channels;
    for c in 0..channels {
        let column: Vec<f64> = x
            .iter()
            .skip(c)
            .step_by(channels)
            .map(|v| f64::from(*v))
            .collect();
        let mean = column.iter().sum::<f64>() / column.len() as f64;
        let variance = column.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / column.len() as f64;
        let scale =
            f64::from(parameters[layer.gamma.start + c]) / (variance + f64::from(EPSILON)).sqrt();
        let shift = f64::from(parameters[layer.beta.start + c]);
        x.iter_mut()
            .skip(c)
            .step_by(channels)
            .for_each(|v| *v = (scale * (f64::from(*v) - mean) + shift).max(0.0) as f32);
    }
}

fn plain_convolution(
    x: &[f32],
    [frames, rows, columns]: [usize; 3],
    layer: &super::layers::Layer,
    stride: usize,
    parameters: &[f32],
) -> (Vec<f32>, [usize; 3]) {
    let shape = [frames, rows / stride, columns / stride];
    let mut y = vec![0.0; shape.iter().product::<usize>() * layer.cout];
    for (at, out) in y.chunks_exact_mut(layer.cout).enumerate() {
        let (frame, oy, ox) = (
            at / (shape[1] * shape[2]),
            at / shape[2] % shape[1],
            at % shape[2],
        );
        for tap in 0..9 {
            let (iy, ix) = (
                (oy * stride + tap / 3) as isize - 1,
                (ox * stride + tap % 3) as isize - 1,
            );
            if iy < 0 || ix < 0 || iy >= rows as isize || ix >= columns as isize {
                continue;
            }
            let input = &x[((frame * rows + iy as usize) * columns + ix as usize) * layer.cin..]
                [..layer.cin];
            for (c, v) in input.iter().enumerate() {
                let weights =
                    &parameters[layer.weight.start + (tap * layer.cin + c) * layer.cout..];
                out.iter_mut().zip(weights).for_each(|(o, w)| *o += v * w);
            }
        }
    }
    plain_norm(&mut y, layer, parameters);
    (y, shape)
}

fn plain_up(x: &[f32], layer: &super::layers::Layer, parameters: &[f32]) -> Vec<f32> {
    let mut y = vec![0.0; x.len() / layer.cin * layer.cout];
    for (input, out) in x
        .chunks_exact(layer.cin)
        .zip(y.chunks_exact_mut(layer.cout))
    {
        for (v, weights) in input
            .iter()
            .zip(parameters[layer.weight.clone()].chunks_exact(layer.cout))
        {
            out.iter_mut().zip(weights).for_each(|(o, w)| *o += v * w);
        }
    }
    plain_norm(&mut y, layer, parameters);
    y
}
