//! Prepares batches on a thread of its own, a few steps ahead.
//!
//! Which frames a step sees and how they are varied depends on the seed and the step alone.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Instant;

use mluc_model::{Grid, HeadKind, Network};

use super::augment::{Augmentation, crop};
use super::error::TrainError;
use super::losses::BatchTargets;
use super::plan::{Plan, Planner};
use super::random::Random;
use super::source::Source;
use super::targets::{Anchors, CellClass, CellLabel, Targets};

/// Batches that wait at most: bounds the memory.
const QUEUE: usize = 2;

/// The weight of a frame's background cells together, where its objects' is 1.
const BACKGROUND_SHARE: f32 = 0.5;

/// A step's input.
#[derive(Debug)]
pub struct Batch {
    /// Which step.
    pub step: u64,
    /// Gathers.
    pub plan: Plan,
    /// Labels.
    pub targets: BatchTargets,
    /// What preparing it took.
    pub seconds: f64,
}

/// Makes batches.
pub struct Preparer {
    source: Arc<dyn Source>,
    augmentation: Option<Augmentation>,
    anchors: Anchors,
    planner: Planner,
    grid: Grid,
    cells: usize,
    /// Logits of an anchor: 1 but for a sigmoid head.
    logits: usize,
    background_cells: usize,
    batch: usize,
    seed: u64,
    /// The order of an epoch, and which.
    order: (u64, Vec<u32>),
}

impl Preparer {
    /// For one network.
    pub fn new(
        source: Arc<dyn Source>,
        augmentation: Option<Augmentation>,
        anchors: Anchors,
        network: &Network,
        batch: usize,
        seed: u64,
    ) -> Preparer {
        let [rows, columns] = network.map_shape();
        Preparer {
            source,
            augmentation,
            anchors,
            planner: Planner::new(network, false),
            grid: network.grid.clone(),
            cells: rows * columns,
            logits: if network.head == HeadKind::Sigmoid {
                network.classes
            } else {
                1
            },
            background_cells: 0,
            batch,
            seed,
            order: (u64::MAX, vec![]),
        }
    }

    /// Also labels as many cells of a frame that hold points and no object.
    pub fn with_background_cells(self, background_cells: usize) -> Preparer {
        Preparer {
            background_cells,
            ..self
        }
    }

    fn frame_number(&mut self, place: u64) -> usize {
        let count = self.source.count() as u64;
        let epoch = place / count;
        if self.order.0 != epoch {
            let mut order: Vec<u32> = (0..count as u32).collect();
            Random::new(self.seed, &[1, epoch]).shuffle(&mut order);
            self.order = (epoch, order);
        }
        self.order.1[(place % count) as usize] as usize
    }

    /// The batch of a step.
    pub fn prepare(&mut self, step: u64) -> Result<Batch, TrainError> {
        let start = Instant::now();
        let (mut scans, mut targets) = (vec![], vec![]);
        for number in 0..self.batch as u64 {
            let place = step * self.batch as u64 + number;
            let frame = self.frame_number(place);
            let mut scene = self.source.scene(frame)?;
            if let Some(augmentation) = &self.augmentation {
                augmentation.apply(&mut scene, &mut Random::new(self.seed, &[2, place]));
            }
            crop(&mut scene, &self.grid);
            targets.push(self.anchors.assign(&scene.objects));
            scans.push(scene.points);
        }
        let plan = self.planner.plan(&scans);
        if self.background_cells > 0 {
            self.label_background(&plan, &mut targets, step);
        }
        let anchors = self.anchors.per_cell();
        let targets = BatchTargets::new(&targets, self.cells, anchors, self.logits);
        Ok(Batch {
            step,
            plan,
            targets,
            seconds: start.elapsed().as_secs_f64(),
        })
    }

    /// Labels cells that hold points and nothing else.
    fn label_background(&self, plan: &Plan, targets: &mut [Targets], step: u64) {
        for (frame, targets) in targets.iter_mut().enumerate() {
            let place = step * self.batch as u64 + frame as u64;
            let mut random = Random::new(self.seed, &[3, place]);
            let anchors = self.anchors.per_cell() as u32;
            let taken: BTreeSet<u32> = targets
                .cells
                .iter()
                .map(|c| c.cell)
                .chain(targets.positives.iter().map(|p| p.cell))
                .chain(targets.ignored.iter().map(|a| a / anchors))
                .collect();
            let first = frame * self.cells;
            let mut free: Vec<u32> = plan
                .map
                .occupied
                .iter()
                .map(|cell| *cell as usize)
                .filter(|cell| (first..first + self.cells).contains(cell))
                .map(|cell| (cell - first) as u32)
                .filter(|cell| !taken.contains(cell))
                .collect();
            random.shuffle(&mut free);
            free.truncate(self.background_cells);
            let weight = BACKGROUND_SHARE / free.len().max(1) as f32;
            targets.cells.extend(free.into_iter().map(|cell| CellLabel {
                cell,
                is: CellClass::Background,
                weight,
            }));
        }
    }

    /// Batches of `steps`, prepared ahead. The thread ends when the receiver is dropped.
    pub fn spawn(mut self, steps: std::ops::Range<u64>) -> Receiver<Result<Batch, TrainError>> {
        let (sender, receiver): (SyncSender<_>, _) = sync_channel(QUEUE);
        std::thread::spawn(move || {
            for step in steps {
                let batch = self.prepare(step);
                let failed = batch.is_err();
                if sender.send(batch).is_err() || failed {
                    return;
                }
            }
        });
        receiver
    }
}
