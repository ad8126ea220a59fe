//! Prepares batches on a thread of its own, a few steps ahead.
//!
//! Which frames a step sees and how they are varied depends on the seed and the step alone.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Instant;

use mluc_model::{Grid, Network};

use super::augment::{Augmentation, crop};
use super::error::TrainError;
use super::losses::BatchTargets;
use super::plan::{Plan, Planner};
use super::random::Random;
use super::source::Source;
use super::targets::Anchors;

/// Batches that wait at most: bounds the memory.
const QUEUE: usize = 2;

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
            batch,
            seed,
            order: (u64::MAX, vec![]),
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
        let targets = BatchTargets::new(&targets, self.cells, self.anchors.per_cell());
        let plan = self.planner.plan(&scans);
        Ok(Batch {
            step,
            plan,
            targets,
            seconds: start.elapsed().as_secs_f64(),
        })
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
