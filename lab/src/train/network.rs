//! The network with its parameters: forward and backward.
//!
//! Parameters are one flat list, so that optimiser, clipping and checkpoint see numbers and nothing else. The chain is
//! that of [`mluc_model::Network`]: sparse layers, map, block 1, block 2, two ups, heads. The two ups are never
//! concatenated at full size: objectness adds what each up contributes, and the other heads run on labelled cells alone.

use std::ops::Range;

use mluc_kernels::{Epilogue, Weights, convolve};
use mluc_model::Network;

use super::halo::Step;
use super::layers::{Activation, Layer, Linear, Pool};
use super::norm::{Statistics, Tail};
use super::plan::{Plan, identity};
use super::random::Random;

/// The heads' layers.
#[derive(Clone, Debug, PartialEq)]
pub struct Heads {
    /// Objectness, a logit an anchor; of a sigmoid head a logit an anchor and class.
    pub presence: Linear,
    /// One embedding a cell; a sigmoid head has none.
    pub embedding: Option<Linear>,
    /// Seven codes an anchor.
    pub boxes: Linear,
    /// Two bins an anchor.
    pub direction: Linear,
    /// The logit of the unknown, one a cell, of an open head.
    pub unknown: Option<Linear>,
}

impl Heads {
    fn new(network: &Network, a: &mut Allocator) -> Heads {
        let features = network.feature_channels();
        let mut all: Vec<Linear> = network
            .heads()
            .into_iter()
            .map(|(name, cout)| a.linear(name, features, cout))
            .collect();
        let mut take = |name: &str| {
            let at = all.iter().position(|head| head.name == name);
            at.map(|at| all.remove(at))
        };
        let (objectness, class) = (take("head.objectness"), take("head.class"));
        let none = || Linear {
            name: String::new(),
            cin: features,
            cout: 0,
            weight: 0..0,
            bias: 0..0,
        };
        Heads {
            presence: objectness.or(class).unwrap_or_else(none),
            embedding: take("head.embedding"),
            boxes: take("head.box").unwrap_or_else(none),
            direction: take("head.direction").unwrap_or_else(none),
            unknown: take("head.unknown"),
        }
    }

    /// Each head.
    pub fn all(&self) -> impl Iterator<Item = &Linear> {
        [&self.presence].into_iter().chain(self.closer())
    }

    /// Those that run on labelled cells alone.
    pub(super) fn closer(&self) -> impl Iterator<Item = &Linear> {
        let first = self.embedding.iter().chain([&self.boxes, &self.direction]);
        first.chain(&self.unknown)
    }
}

/// The network's layers, and where their numbers lie.
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
    /// Of block 1.
    pub up1: Layer,
    /// Of block 2; 4 * channels columns, one set for each cell of 2x2.
    pub up2: Layer,
    /// Heads.
    pub heads: Heads,
    /// Count of parameters.
    pub parameters: usize,
}

/// Hands out ranges of the flat list.
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

    fn linear(&mut self, name: &str, cin: usize, cout: usize) -> Linear {
        let (weight, bias) = (self.range(cin * cout), self.range(cout));
        Linear {
            name: name.to_owned(),
            cin,
            cout,
            weight,
            bias,
        }
    }
}

/// What the forward pass leaves.
#[derive(Debug, Default)]
pub struct Pass {
    pub(super) sparse: Vec<Activation>,
    pub(super) map: Vec<f32>,
    pub(super) block1: Vec<Activation>,
    pub(super) block2: Vec<Activation>,
    pub(super) up1: Activation,
    pub(super) up2: Activation,
    /// Share of the presence logits by row of up 1 and of up 2 (the bias is in the first).
    pub presence: [Vec<f32>; 2],
    pub(super) labelled_features: Vec<f32>,
    /// Embedding of each labelled cell.
    pub embedding: Vec<f32>,
    /// Box codes of each labelled cell's anchors.
    pub boxes: Vec<f32>,
    /// Direction logits of each labelled cell's anchors.
    pub direction: Vec<f32>,
    /// Logit of the unknown of each labelled cell.
    pub unknown: Vec<f32>,
}

/// Gradients of the loss with respect to the outputs of a [`Pass`], of the same shapes.
#[derive(Clone, Debug, Default)]
pub struct OutputGradients {
    /// By row of up 1 and up 2.
    pub presence: [Vec<f32>; 2],
    /// Embeddings.
    pub embedding: Vec<f32>,
    /// Box codes.
    pub boxes: Vec<f32>,
    /// Direction logits.
    pub direction: Vec<f32>,
    /// Logits of the unknown.
    pub unknown: Vec<f32>,
}

impl OutputGradients {
    /// In the order of [`Heads::closer`], those that a head has.
    pub(super) fn closer(&self) -> impl Iterator<Item = &Vec<f32>> {
        let all = [&self.embedding, &self.boxes, &self.direction, &self.unknown];
        all.into_iter().filter(|gradient| !gradient.is_empty())
    }
}

/// Running statistics, by [`Layer::norm`].
pub type Running = Vec<Statistics>;

impl Chain {
    /// Lays out the parameters of `network`.
    pub fn new(network: &Network) -> Chain {
        let mut a = Allocator::default();
        let sparse = network
            .sparse
            .iter()
            .map(|l| a.layer(&l.name, l.taps(), l.cin, l.cout, 1))
            .collect();
        let block1 = network
            .block1
            .iter()
            .map(|l| a.layer(&l.name, 9, l.cin, l.cout, 1))
            .collect();
        let block2 = network
            .block2
            .iter()
            .map(|l| a.layer(&l.name, 9, l.cin, l.cout, 1))
            .collect();
        let (up1, up2) = (&network.up1, &network.up2);
        let up1 = a.layer(&up1.name, 1, up1.cin, up1.cout, 1);
        let up2 = a.layer(&up2.name, 1, up2.cin, up2.cout, 4);
        let heads = Heads::new(network, &mut a);
        let parameters = a.used;
        Chain {
            network: network.clone(),
            sparse,
            block1,
            block2,
            up1,
            up2,
            heads,
            parameters,
        }
    }

    /// Multiplies gradients of layers' inputs in bf16, where a layer's channels are worth it.
    pub fn use_bf16(&mut self) {
        let blocks = self
            .sparse
            .iter_mut()
            .chain(&mut self.block1)
            .chain(&mut self.block2);
        for layer in blocks.chain([&mut self.up1, &mut self.up2]) {
            layer.bf16 = layer.cin >= 16 && layer.cin % 2 == 0 && layer.cout % 2 == 0;
        }
    }

    /// Layers with batch norm, in the order of [`Layer::norm`].
    pub fn layers(&self) -> impl Iterator<Item = &Layer> {
        let blocks = self.sparse.iter().chain(&self.block1).chain(&self.block2);
        blocks.chain([&self.up1, &self.up2])
    }

    /// First parameters: uniform in +-1/sqrt(fan in) (the default of the public implementations), batch norm 1 and 0;
    /// objectness starts at 0.01, boxes near 0, the embedding at the prototypes' centre T/C.
    pub fn initial(&self, seed: u64, prototype_scale: f32) -> Vec<f32> {
        let mut parameters = vec![0.0; self.parameters];
        let mut random = Random::new(seed, &[0x1417]);
        for layer in self.layers() {
            let bound = 1.0 / ((layer.taps * layer.cin) as f64).sqrt();
            parameters[layer.weight.clone()].fill_with(|| random.uniform(-bound, bound) as f32);
            parameters[layer.gamma.clone()].fill(1.0);
        }
        let Heads {
            presence,
            embedding,
            boxes,
            direction,
            unknown,
        } = &self.heads;
        let bound = 1.0 / (presence.cin as f64).sqrt();
        parameters[presence.weight.clone()].fill_with(|| random.uniform(-bound, bound) as f32);
        parameters[presence.bias.clone()].fill(-(99.0f32).ln());
        if let Some(embedding) = embedding {
            let centre = prototype_scale / self.network.classes as f32;
            parameters[embedding.weight.clone()].fill_with(|| 0.01 * random.normal() as f32);
            parameters[embedding.bias.clone()].fill(centre);
        }
        parameters[boxes.weight.clone()].fill_with(|| 0.001 * random.normal() as f32);
        parameters[direction.weight.clone()].fill_with(|| random.uniform(-bound, bound) as f32);
        if let Some(unknown) = unknown {
            parameters[unknown.weight.clone()].fill_with(|| 0.01 * random.normal() as f32);
        }
        parameters
    }

    /// Statistics before any step: mean 0, variance 1.
    pub fn initial_running(&self) -> Running {
        let unit = |l: &Layer| Statistics {
            mean: vec![0.0; l.channels],
            variance: vec![1.0; l.channels],
            count: 0.0,
        };
        self.layers().map(unit).collect()
    }

    /// The batch statistics of a pass, in the order of [`Layer::norm`].
    pub fn statistics<'a>(&self, pass: &'a Pass) -> impl Iterator<Item = &'a Statistics> {
        let blocks = pass.sparse.iter().chain(&pass.block1).chain(&pass.block2);
        blocks.chain([&pass.up1, &pass.up2]).map(|a| &a.statistics)
    }

    /// Runs the network. `labelled`: cells of the full map whose embedding, boxes and directions are wanted. With
    /// `running`, batch norm uses those statistics (evaluation).
    pub fn forward(
        &self,
        parameters: &[f32],
        plan: &Plan,
        labelled: &[u32],
        running: Option<&Running>,
        pool: &mut Pool,
    ) -> Pass {
        let mut pass = self.forward_sparse(parameters, plan, running, pool);
        self.forward_map(parameters, plan, labelled, running, &mut pass, pool);
        pass
    }

    /// The first part of [`Chain::forward`]: sparse layers, and their rows put onto the map.
    pub fn forward_sparse(
        &self,
        parameters: &[f32],
        plan: &Plan,
        running: Option<&Running>,
        pool: &mut Pool,
    ) -> Pass {
        let mut pass = Pass::default();
        for (number, layer) in self.sparse.iter().enumerate() {
            let input = pass
                .sparse
                .last()
                .map_or(&plan.sparse.voxels, |a: &Activation| &a.y);
            let gather = &plan.sparse.gathers[number];
            let running = running.map(|r| &r[layer.norm]);
            let a = layer.forward(parameters, input, gather, Tail::default(), running, pool);
            pass.sparse.push(a);
        }
        pass.map = self.scatter(pass.sparse.last().map_or(&[], |a| &a.y), plan, pool);
        pass
    }

    /// The second part of [`Chain::forward`], from the map that the first left: blocks, ups, heads.
    pub fn forward_map(
        &self,
        parameters: &[f32],
        plan: &Plan,
        labelled: &[u32],
        running: Option<&Running>,
        pass: &mut Pass,
        pool: &mut Pool,
    ) {
        let of = |layer: &Layer| running.map(|r| &r[layer.norm]);
        let map = &plan.map;
        pass.block1 = self.block(
            &self.block1,
            parameters,
            &pass.map,
            &map.block1,
            running,
            pool,
        );
        let middle = last(&pass.block1);
        pass.block2 = self.block(&self.block2, parameters, middle, &map.block2, running, pool);
        let [tail1, tail2] = self.tails(plan);
        let [rows1, rows2] = &map.identity;
        pass.up1 = self
            .up1
            .forward(parameters, middle, rows1, tail1, of(&self.up1), pool);
        let half = last(&pass.block2);
        pass.up2 = self
            .up2
            .forward(parameters, half, rows2, tail2, of(&self.up2), pool);
        self.heads(parameters, plan, labelled, pass);
    }

    fn block(
        &self,
        layers: &[Layer],
        parameters: &[f32],
        input: &[f32],
        steps: &[Step],
        running: Option<&Running>,
        pool: &mut Pool,
    ) -> Vec<Activation> {
        let mut activations: Vec<Activation> = vec![];
        for (layer, step) in layers.iter().zip(steps) {
            let input = activations.last().map_or(input, |a| &a.y);
            let running = running.map(|r| &r[layer.norm]);
            let a = layer.forward(
                parameters,
                input,
                &step.gather,
                tail_of(step),
                running,
                pool,
            );
            activations.push(a);
        }
        activations
    }

    /// Sparse rows onto the map: channel = c * depth + z.
    fn scatter(&self, rows: &[f32], plan: &Plan, pool: &mut Pool) -> Vec<f32> {
        let width = self.network.map_channels();
        let channels = self.sparse.last().map_or(0, |l| l.channels);
        let depth = width / channels.max(1);
        let mut map = pool.take(plan.map.map_rows * width);
        map.fill(0.0);
        for ((row, z), from) in plan.map.scatter.iter().zip(rows.chunks_exact(channels)) {
            let cell = &mut map[*row as usize * width..][..width];
            let level = cell[*z as usize..].iter_mut().step_by(depth);
            level.zip(from).for_each(|(to, from)| *to = *from);
        }
        map
    }

    /// The tails of up 1 and up 2.
    pub(super) fn tails(&self, plan: &Plan) -> [Tail; 2] {
        let multiplicity = |steps: &[Step]| steps.last().map_or(0, |s| s.multiplicity);
        [
            Tail {
                rows: 1,
                multiplicity: multiplicity(&plan.map.block1),
            },
            Tail {
                rows: 4,
                multiplicity: multiplicity(&plan.map.block2),
            },
        ]
    }

    /// The presence weights of up 1's channels and of up 2's.
    pub(super) fn presence_halves(&self) -> [Range<usize>; 2] {
        let head = &self.heads.presence;
        let middle = head.weight.start + self.up1.channels * head.cout;
        [head.weight.start..middle, middle..head.weight.end]
    }

    fn heads(&self, parameters: &[f32], plan: &Plan, labelled: &[u32], pass: &mut Pass) {
        let [first, second] = self.presence_halves();
        let anchors = self.heads.presence.cout;
        let share = |y: &[f32], channels: usize, weights: Range<usize>, bias: Option<&[f32]>| {
            let rows = y.len() / channels;
            let weights = Weights::pack(1, channels, anchors, &parameters[weights]);
            let mut logits = vec![0.0; rows * anchors];
            let epilogue = Epilogue { bias, relu: false };
            convolve(y, &identity(rows), &weights, epilogue, None, &mut logits);
            logits
        };
        let bias = &parameters[self.heads.presence.bias.clone()];
        pass.presence = [
            share(&pass.up1.y, self.up1.channels, first, Some(bias)),
            share(&pass.up2.y, self.up2.channels, second, None),
        ];
        pass.labelled_features = self.features(plan, labelled, [&pass.up1.y, &pass.up2.y]);
        let rows = identity(labelled.len());
        let run = |head: &Linear| head.forward(parameters, &pass.labelled_features, &rows);
        let heads = &self.heads;
        let [boxes, direction] = [&heads.boxes, &heads.direction].map(run);
        let [embedding, unknown] = [&heads.embedding, &heads.unknown]
            .map(|head| head.as_ref().map(run).unwrap_or_default());
        (pass.embedding, pass.boxes) = (embedding, boxes);
        (pass.direction, pass.unknown) = (direction, unknown);
    }

    /// Rows of `cells`: up 1's channels, then up 2's.
    fn features(&self, plan: &Plan, cells: &[u32], [up1, up2]: [&[f32]; 2]) -> Vec<f32> {
        let (width1, width2) = (self.up1.channels, self.up2.channels);
        let mut rows = Vec::with_capacity(cells.len() * (width1 + width2));
        for &cell in cells {
            rows.extend_from_slice(
                &up1[plan.map.up1_row[cell as usize] as usize * width1..][..width1],
            );
            rows.extend_from_slice(
                &up2[plan.map.up2_row[cell as usize] as usize * width2..][..width2],
            );
        }
        rows
    }
}

impl Pass {
    /// Gives the maps back for the next step.
    pub fn recycle(self, pool: &mut Pool) {
        let blocks = self
            .sparse
            .into_iter()
            .chain(self.block1)
            .chain(self.block2);
        for activation in blocks.chain([self.up1, self.up2]) {
            pool.give(activation.x);
            pool.give(activation.y);
        }
        pool.give(self.map);
    }
}

pub(super) fn tail_of(step: &Step) -> Tail {
    Tail {
        rows: 1,
        multiplicity: step.multiplicity,
    }
}

pub(super) fn last(block: &[Activation]) -> &[f32] {
    block.last().map_or(&[], |a| &a.y)
}
