//! The network with its parameters, and its forward pass.
//!
//! Parameters are one flat list, so that optimiser, clipping and checkpoint need only numbers. The chain is the one of
//! [`mluc_model::Network`]: sparse layers, map, block 1, block 2, two ups, heads. The two ups are never concatenated at
//! full size: objectness adds the contributions of the ups, and the other heads run only on labelled cells.

use crate::layers::{Layer, Linear, RunningStatistics, forward_all, linear};
use crate::plan::{MapPlan, Plan};
use crate::{norm::Activation, norm::Statistics, pool::Pool};
use mluc_geometry::Random;
use mluc_model::{DenseLayer, Network};
use std::ops::Range;

/// The heads' layers.
#[derive(Clone, Debug, PartialEq)]
pub struct Heads {
    /// Objectness, one logit per anchor; for a sigmoid head one logit per anchor and class.
    pub presence: Linear,
    /// One embedding per cell; a sigmoid head has none.
    pub embedding: Option<Linear>,
    /// Seven codes per anchor.
    pub boxes: Linear,
    /// Two bins per anchor.
    pub direction: Linear,
    /// The unknown logit of an open head, one per cell.
    pub unknown: Option<Linear>,
}

impl Heads {
    /// Each head.
    pub fn all(&self) -> impl Iterator<Item = &Linear> {
        [&self.presence].into_iter().chain(self.of_labelled())
    }

    /// The heads that run only on labelled cells.
    pub(crate) fn of_labelled(&self) -> impl Iterator<Item = &Linear> {
        self.embedding.iter().chain([&self.boxes, &self.direction]).chain(&self.unknown)
    }
}

/// The network's layers, and the positions of their parameters.
#[derive(Clone, Debug)]
pub struct Chain {
    /// The description.
    pub network: Network,
    /// 3-D layers.
    pub sparse: Vec<Layer>,
    /// Full-size layers.
    pub block1: Vec<Layer>,
    /// Half-size layers.
    pub block2: Vec<Layer>,
    /// Up layer of block 1.
    pub up1: Layer,
    /// Up layer of block 2; 4 * channels columns, one set for each cell of the 2x2.
    pub up2: Layer,
    /// Heads.
    pub heads: Heads,
    /// Number of parameters.
    pub parameters: usize,
}

/// Allocates ranges of the flat list.
#[derive(Default)]
struct Allocator {
    used: usize,
    norms: usize,
}

impl Allocator {
    fn range(&mut self, count: usize) -> Range<usize> {
        self.used += count;
        self.used - count..self.used
    }

    fn layer(&mut self, name: &str, taps: usize, cin: usize, cout: usize, copies: usize) -> Layer {
        self.norms += 1;
        Layer {
            name: name.to_owned(),
            taps,
            cin,
            cout: cout * copies,
            channels: cout,
            weight: self.range(taps * cin * cout * copies),
            gamma: self.range(cout),
            beta: self.range(cout),
            norm: self.norms - 1,
            bf16: false,
        }
    }

    fn block(&mut self, layers: &[DenseLayer]) -> Vec<Layer> {
        let layer = |l: &DenseLayer| self.layer(&l.name, 9, l.cin, l.cout, 1);
        layers.iter().map(layer).collect()
    }

    fn heads(&mut self, network: &Network) -> Heads {
        let cin = network.feature_channels();
        let head = |(name, cout): (&str, usize)| Linear {
            name: name.to_owned(),
            cin,
            cout,
            weight: self.range(cin * cout),
            bias: self.range(cout),
        };
        let all: Vec<Linear> = network.heads().into_iter().map(head).collect();
        let find = |name: &str| all.iter().find(|head| head.name == name).cloned();
        let presence = find("head.objectness").or_else(|| find("head.class"));
        Heads {
            presence: presence.unwrap_or_default(),
            embedding: find("head.embedding"),
            boxes: find("head.box").unwrap_or_default(),
            direction: find("head.direction").unwrap_or_default(),
            unknown: find("head.unknown"),
        }
    }
}

/// Outputs of the heads, or the gradient of the loss with respect to them.
#[derive(Clone, Debug, Default)]
pub struct Outputs {
    /// Contributions to the presence logits, by row of up 1 and of up 2 (the bias is in the first).
    pub presence: [Vec<f32>; 2],
    /// Embedding of each labelled cell.
    pub embedding: Vec<f32>,
    /// Box codes of each labelled cell's anchors.
    pub boxes: Vec<f32>,
    /// Direction logits of each labelled cell's anchors.
    pub direction: Vec<f32>,
    /// Unknown logit of each labelled cell.
    pub unknown: Vec<f32>,
}

impl Outputs {
    /// The non-empty outputs, in the order of [`Heads::of_labelled`].
    pub(crate) fn of_labelled(&self) -> impl Iterator<Item = &Vec<f32>> {
        let all = [&self.embedding, &self.boxes, &self.direction, &self.unknown];
        all.into_iter().filter(|values| !values.is_empty())
    }
}

/// Input of both passes of a step.
#[derive(Clone, Copy)]
pub struct StepInput<'a> {
    /// Parameters of the network.
    pub parameters: &'a [f32],
    /// The rows of a batch.
    pub plan: &'a Plan,
    /// Cells of the full map for which embedding, boxes and directions are computed.
    pub labelled: &'a [u32],
    /// Statistics for batch norm (evaluation); with `None` it uses those of the batch.
    pub running: Option<&'a RunningStatistics>,
}

/// Results of the forward pass.
#[derive(Debug, Default)]
pub struct Pass {
    /// Outputs of the heads.
    pub outputs: Outputs,
    pub(crate) sparse: Vec<Activation>,
    pub(crate) map: Vec<f32>,
    pub(crate) block1: Vec<Activation>,
    pub(crate) block2: Vec<Activation>,
    pub(crate) up1: Activation,
    pub(crate) up2: Activation,
    pub(crate) labelled_features: Vec<f32>,
}

impl<'a> StepInput<'a> {
    /// Input with the batch's own statistics, as in training.
    pub fn new(parameters: &'a [f32], plan: &'a Plan, labelled: &'a [u32]) -> StepInput<'a> {
        StepInput { parameters, plan, labelled, running: None }
    }
}

impl Chain {
    /// Lays out the parameters of `network`.
    pub fn new(network: &Network) -> Chain {
        let mut a = Allocator::default();
        let sparse = network.sparse.iter().map(|l| a.layer(&l.name, l.taps(), l.cin, l.cout, 1));
        let (up1, up2) = (&network.up1, &network.up2);
        Chain {
            network: network.clone(),
            sparse: sparse.collect(),
            block1: a.block(&network.block1),
            block2: a.block(&network.block2),
            up1: a.layer(&up1.name, 1, up1.cin, up1.cout, 1),
            up2: a.layer(&up2.name, 1, up2.cin, up2.cout, 4),
            heads: a.heads(network),
            parameters: a.used,
        }
    }

    /// Multiplies in bf16 in layers with enough channels for a gain.
    pub fn use_bf16(&mut self) {
        let blocks = self.sparse.iter_mut().chain(&mut self.block1).chain(&mut self.block2);
        for layer in blocks.chain([&mut self.up1, &mut self.up2]) {
            layer.bf16 = layer.cin >= 16 && layer.cin % 2 == 0 && layer.cout % 2 == 0;
        }
    }

    /// Layers with batch norm, in the order of [`Layer::norm`].
    pub fn layers(&self) -> impl Iterator<Item = &Layer> {
        self.sparse.iter().chain(&self.block1).chain(&self.block2).chain([&self.up1, &self.up2])
    }

    /// Initial parameters: uniform in +-1/sqrt(fan in) (the default of the public implementations), batch norm 1 and 0;
    /// objectness starts at 0.01, boxes near 0, the embedding at the prototypes' centre T/C.
    pub fn initial(&self, seed: u64, prototype_scale: f32) -> Vec<f32> {
        let mut parameters = vec![0.0; self.parameters];
        let mut random = Random::new(seed, &[0x1417]);
        let uniform = |to: &mut [f32], fan_in: usize, random: &mut Random| {
            let bound = 1.0 / (fan_in as f64).sqrt();
            to.fill_with(|| random.uniform(-bound, bound) as f32);
        };
        let normal = |to: &mut [f32], scale: f32, random: &mut Random| {
            to.fill_with(|| scale * random.normal() as f32);
        };
        for layer in self.layers() {
            let (weight, fan_in) = (layer.weight.clone(), layer.taps * layer.cin);
            uniform(&mut parameters[weight], fan_in, &mut random);
            parameters[layer.gamma.clone()].fill(1.0);
        }
        let heads = &self.heads;
        let of = |head: &Linear| head.weight.clone();
        let features = heads.presence.cin;
        uniform(&mut parameters[of(&heads.presence)], features, &mut random);
        parameters[heads.presence.bias.clone()].fill(-(99.0f32).ln());
        if let Some(embedding) = &heads.embedding {
            let centre = prototype_scale / self.network.classes as f32;
            normal(&mut parameters[of(embedding)], 0.01, &mut random);
            parameters[embedding.bias.clone()].fill(centre);
        }
        normal(&mut parameters[of(&heads.boxes)], 0.001, &mut random);
        uniform(&mut parameters[of(&heads.direction)], features, &mut random);
        if let Some(unknown) = &heads.unknown {
            normal(&mut parameters[of(unknown)], 0.01, &mut random);
        }
        parameters
    }

    /// Statistics before any step: mean 0, variance 1.
    pub fn initial_running(&self) -> RunningStatistics {
        let unit = |l: &Layer| Statistics {
            mean: vec![0.0; l.channels],
            var: vec![1.0; l.channels],
            count: 0.0,
        };
        self.layers().map(unit).collect()
    }

    /// Runs the network.
    pub fn forward(&self, input: &StepInput, pool: &mut Pool) -> Pass {
        let (p, running) = (input.parameters, input.running);
        let (voxels, plans) = (&input.plan.voxels, &input.plan.sparse);
        let sparse = forward_all(&self.sparse, p, voxels, plans, running, pool);
        let plan = &input.plan.map;
        let map = self.scatter(last(&sparse), plan, pool);
        let block1 = forward_all(&self.block1, p, &map, &plan.block1, running, pool);
        let middle = last(&block1);
        let block2 = forward_all(&self.block2, p, middle, &plan.block2, running, pool);
        let half = last(&block2);
        let mut pass = Pass {
            up1: self.up1.forward(p, middle, &plan.ups[0], running, pool),
            up2: self.up2.forward(p, half, &plan.ups[1], running, pool),
            sparse,
            map,
            block1,
            block2,
            ..Pass::default()
        };
        self.run_heads(input, &mut pass);
        pass
    }

    /// Writes sparse rows to the map: channel = c * depth + z.
    fn scatter(&self, rows: &[f32], plan: &MapPlan, pool: &mut Pool) -> Vec<f32> {
        let width = self.network.map_channels();
        let channels = self.sparse.last().map_or(0, |l| l.channels);
        let depth = width / channels.max(1);
        let mut map = pool.take(plan.occupied.len() * width);
        map.fill(0.0);
        for ((row, z), from) in plan.scatter.iter().zip(rows.chunks_exact(channels)) {
            let cell = &mut map[*row as usize * width..][..width];
            let level = cell[*z as usize..].iter_mut().step_by(depth);
            level.zip(from).for_each(|(to, from)| *to = *from);
        }
        map
    }

    /// The presence weights for the channels of up 1 and of up 2.
    pub(crate) fn presence_halves(&self) -> [Range<usize>; 2] {
        let head = &self.heads.presence;
        let middle = head.weight.start + self.up1.channels * head.cout;
        [head.weight.start..middle, middle..head.weight.end]
    }

    fn run_heads(&self, input: &StepInput, pass: &mut Pass) {
        let (parameters, labelled) = (input.parameters, input.labelled);
        let [first, second] = self.presence_halves();
        let anchors = self.heads.presence.cout;
        let share = |y: &[f32], channels: usize, weights: Range<usize>, bias: Option<&[f32]>| {
            linear(y, [channels, anchors], &parameters[weights], bias)
        };
        let bias = &parameters[self.heads.presence.bias.clone()];
        let (up1, up2) = (&pass.up1.y, &pass.up2.y);
        let presence = [
            share(up1, self.up1.channels, first, Some(bias)),
            share(up2, self.up2.channels, second, None),
        ];
        let features = self.features(&input.plan.map, labelled, [up1, up2]);
        let run = |head: &Linear| head.forward(parameters, &features);
        let run_if_any = |head: &Option<Linear>| head.as_ref().map(run).unwrap_or_default();
        pass.outputs = Outputs {
            presence,
            embedding: run_if_any(&self.heads.embedding),
            boxes: run(&self.heads.boxes),
            direction: run(&self.heads.direction),
            unknown: run_if_any(&self.heads.unknown),
        };
        pass.labelled_features = features;
    }

    /// Rows of `cells`: the channels of up 1, then of up 2.
    fn features(&self, plan: &MapPlan, cells: &[u32], [up1, up2]: [&[f32]; 2]) -> Vec<f32> {
        let (width1, width2) = (self.up1.channels, self.up2.channels);
        let mut rows = Vec::with_capacity(cells.len() * (width1 + width2));
        for &cell in cells {
            let [row1, row2] = plan.up_rows(cell as usize);
            rows.extend_from_slice(&up1[row1 * width1..][..width1]);
            rows.extend_from_slice(&up2[row2 * width2..][..width2]);
        }
        rows
    }
}

impl Pass {
    /// The batch statistics, in the order of [`Layer::norm`].
    pub fn statistics(&self) -> impl Iterator<Item = &Statistics> {
        let blocks = self.sparse.iter().chain(&self.block1).chain(&self.block2);
        blocks.chain([&self.up1, &self.up2]).map(|a| &a.statistics)
    }

    /// Returns the maps to the pool for the next step.
    pub fn recycle(self, pool: &mut Pool) {
        let blocks = self.sparse.into_iter().chain(self.block1).chain(self.block2);
        for activation in blocks.chain([self.up1, self.up2]) {
            pool.give(activation.x);
            pool.give(activation.y);
        }
        pool.give(self.map);
    }
}

pub(crate) fn last(block: &[Activation]) -> &[f32] {
    block.last().map_or(&[], |a| &a.y)
}
