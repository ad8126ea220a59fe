//! A step to do again and again: one batch, fixed weights, a fixed gradient of the outputs.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use mluc_bench::clock::{Lap, laps};
use mluc_dataset::Dataset;
use mluc_geometry::{Random, quantile_of};
use mluc_model::{Manifest, Network};
use mluc_train::TrainSettings;
use mluc_train::anchors::Anchors;
use mluc_train::augment::crop;
use mluc_train::batch_targets::BatchTargets;
use mluc_train::halo::Cells;
use mluc_train::layers::Linear;
use mluc_train::network::{Chain, Outputs, Pass, StepInput};
use mluc_train::plan::{MapPlan, Plan, Planner};
use mluc_train::pool::Pool;
use mluc_train::scan::LabelledScan;
use mluc_train::source::ScanSource;
use serde::Serialize;

/// Of weights and gradients; another would do as well.
const SEED: u64 = 3;
/// Plans that are timed.
const PLANS: usize = 3;

/// Milliseconds of a step's parts.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct Times {
    sparse_forward: Lap,
    map_forward: Lap,
    map_backward: Lap,
    sparse_backward: Lap,
}

/// Milliseconds of what the loader's thread does for a batch besides reading and labels; medians.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct PlanTimes {
    /// Voxels, rulebooks, halo.
    all: f64,
    /// The halo alone: what dense layers do without.
    halo: f64,
}

pub(crate) struct Work {
    pub(crate) chain: Chain,
    pub(crate) parameters: Vec<f32>,
    pub(crate) plan: Plan,
    pub(crate) plan_ms: PlanTimes,
    /// Cells where every head is run; elsewhere it is the presence alone.
    pub(crate) labelled: Vec<u32>,
    /// Of the presence logits, cell by cell.
    pub(crate) presence_gradient: Vec<f32>,
    pub(crate) outputs: Outputs,
    /// Has the gradients of the last step, in the order of the parameters.
    pub(crate) pool: Pool,
}

impl Work {
    /// Frames of a folder as the trainer sees them, not augmented.
    pub(crate) fn read(settings: &TrainSettings, data: &Path, frames: &[usize]) -> Result<Work> {
        let manifest = settings.manifest();
        let network = &manifest.network;
        let scenes = read_scenes(&manifest, data, frames)?;
        let anchors = Anchors::of(&manifest);
        let targets: Vec<_> = scenes.iter().map(|s| anchors.assign(&s.objects)).collect();
        let [rows, columns] = network.map_shape();
        let labelled = BatchTargets::new(&targets, rows * columns, anchors.per_cell(), 1).labelled;
        let scans: Vec<_> = scenes.into_iter().map(|scene| scene.points).collect();
        let (plan, plan_ms) = timed_plan(network, &scans);
        let chain = Chain::new(network);
        let mut random = Random::new(SEED, &[]);
        let mut normal =
            |count: usize| -> Vec<f32> { (0..count).map(|_| random.normal() as f32).collect() };
        let presence_gradient = normal(plan.map.cells() * chain.heads.presence.cout);
        let mut closer = |head: &Linear| normal(labelled.len() * head.cout);
        let outputs = Outputs {
            presence: Default::default(),
            embedding: chain.heads.embedding.as_ref().map_or(vec![], &mut closer),
            boxes: closer(&chain.heads.boxes),
            direction: closer(&chain.heads.direction),
            unknown: vec![],
        };
        let mut work = Work {
            parameters: chain.initial(SEED, settings.prototype_scale()),
            pool: Pool::new(chain.parameters),
            chain,
            plan,
            plan_ms,
            labelled,
            presence_gradient,
            outputs,
        };
        work.share_presence_gradient();
        Ok(work)
    }

    /// Lists every cell of the map, and labels it: the same numbers come out, at the cost of dense layers.
    pub(crate) fn compute_every_cell(&mut self) {
        let map = &self.plan.map;
        let scatter = scatter_of(map);
        let cells = Cells::from_marks(map.shape, &vec![true; map.cells()]);
        self.plan.map = MapPlan::from_cells(&self.chain.network, cells, &scatter);
        let count = self.plan.map.cells();
        let labelled = std::mem::replace(&mut self.labelled, (0..count as u32).collect());
        let Outputs {
            embedding,
            boxes,
            direction,
            ..
        } = &mut self.outputs;
        for gradient in [embedding, boxes, direction] {
            *gradient = spread(gradient, &labelled, count);
        }
        self.share_presence_gradient();
    }

    /// A cell's logit is the sum of a row of up 1 and one of up 2; many cells may read the same row.
    fn share_presence_gradient(&mut self) {
        let (map, anchors) = (&self.plan.map, self.chain.heads.presence.cout);
        let [rows1, rows2] = [0, 1].map(|up| map.ups[up].gather.outputs());
        self.outputs.presence = [vec![0.0; rows1 * anchors], vec![0.0; 4 * rows2 * anchors]];
        let rows = [&map.up1_row, &map.up2_row];
        for (to, row_of) in self.outputs.presence.iter_mut().zip(rows) {
            let gradients = self.presence_gradient.chunks_exact(anchors);
            for (row, from) in row_of.iter().zip(gradients) {
                let to = &mut to[*row as usize * anchors..][..anchors];
                to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
            }
        }
    }

    pub(crate) fn step(&mut self) -> Times {
        let (pass, times) = self.run();
        pass.recycle(&mut self.pool);
        times
    }

    /// A step, and what its forward half left.
    pub(crate) fn run(&mut self) -> (Pass, Times) {
        let (chain, plan, pool) = (&self.chain, &self.plan, &mut self.pool);
        let input = StepInput::new(&self.parameters, plan, &self.labelled);
        let mut lap = laps();
        let mut pass = chain.forward_sparse(&input, pool);
        let sparse_forward = lap();
        chain.forward_map(&input, &mut pass, pool);
        let map_forward = lap();
        pool.gradients.fill(0.0);
        let outputs = &self.outputs;
        let map = chain.backward_map(&input, &pass, outputs, pool);
        let map_backward = lap();
        chain.backward_sparse(&input, &pass, &map, pool);
        pool.give(map);
        let times = Times {
            sparse_forward,
            map_forward,
            map_backward,
            sparse_backward: lap(),
        };
        (pass, times)
    }
}

fn read_scenes(manifest: &Manifest, data: &Path, frames: &[usize]) -> Result<Vec<LabelledScan>> {
    let names = manifest.classes.iter().map(|c| c.name.clone()).collect();
    let source = ScanSource {
        dataset: Dataset::open(data)?,
        classes: names,
        takes_synthetic_unknown: false,
        input: manifest.network.input,
    };
    let read = |&frame: &usize| {
        let count = source.count();
        ensure!(frame < count, "{count} frames, found --frame {frame}");
        let scene = source.scan(frame);
        let mut scene = scene.with_context(|| data.display().to_string())?;
        crop(&mut scene, &manifest.network.grid);
        Ok(scene)
    };
    frames.iter().map(read).collect()
}

fn timed_plan(network: &Network, scans: &[Vec<[f32; 4]>]) -> (Plan, PlanTimes) {
    let mut planner = Planner::new(network);
    let (mut all, mut halo) = (vec![], vec![]);
    // The first is not counted.
    let mut plan = planner.plan(scans);
    for _ in 0..PLANS {
        let mut lap = laps();
        plan = planner.plan(scans);
        all.push(lap().wall);
        let scatter = scatter_of(&plan.map);
        lap();
        let again = MapPlan::new(network, scans.len(), &scatter);
        halo.push(lap().wall);
        debug_assert_eq!(again.occupied, plan.map.occupied);
    }
    let [all, halo] = [all, halo].map(|ms| quantile_of(ms, 0.5).unwrap_or_default());
    (plan, PlanTimes { all, halo })
}

/// Cell and height of each row that the map reads.
pub(crate) fn scatter_of(map: &MapPlan) -> Vec<(u32, u32)> {
    let cell_of = |&(row, z): &(u32, u32)| (map.occupied[row as usize], z);
    map.scatter.iter().map(cell_of).collect()
}

/// Rows of some cells among rows of all, 0 elsewhere.
fn spread(rows: &[f32], cells: &[u32], count: usize) -> Vec<f32> {
    let width = rows.len() / cells.len().max(1);
    let mut all = vec![0.0; count * width];
    for (cell, row) in cells.iter().zip(rows.chunks_exact(width.max(1))) {
        all[*cell as usize * width..][..width].copy_from_slice(row);
    }
    all
}
