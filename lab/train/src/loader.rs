//! Prepares batches on separate threads, a few steps ahead.
//!
//! The frames of a step and their augmentation depend only on the seed and the step.

use crate::plan::{Plan, Planner};
use crate::targets::{CellClass, CellLabel, Targets};
use crate::{anchors::Anchors, batch_targets::BatchTargets, database::Database, error::TrainError};
use crate::{augment::Augmentation, augment::crop, kind::Setting};
use crate::{scan::LabelledScan, settings::TrainSettings, source::ScanSource, stream, thin::thin};
use crossbeam_channel::{Receiver, bounded};
use mluc_geometry::Random;
use mluc_model::{AnchorClass, HeadKind, Manifest, VoxelInput};
use std::{collections::BTreeSet, collections::VecDeque, sync::Arc};

/// Maximum number of waiting batches per thread, to limit memory.
const QUEUE: usize = 2;
/// Total weight of a frame's background cells, where the total of its objects is 1.
const BACKGROUND_SHARE: f32 = 0.5;

/// A step's input.
#[derive(Debug)]
pub struct Batch {
    /// Gathers of the layers.
    pub plan: Plan,
    /// Labels.
    pub targets: BatchTargets,
}

/// Everything that batches are made from.
#[derive(Clone)]
pub struct DataLoader {
    source: ScanSource,
    augmentation: Augmentation,
    manifest: Manifest,
    /// Mean l, w, h of the known classes.
    classes_m: Vec<[f64; 3]>,
    anchors: Anchors,
    planner: Planner,
    /// Number of cells per frame to label as background: cells with points and without an object.
    background_cells: usize,
    batch: usize,
    seed: u64,
    /// The epoch, and its order of the frames.
    order: (u64, Vec<u32>),
}

impl DataLoader {
    /// The loader of a run; it augments frames with the objects of `database` where the settings say so.
    pub fn new(
        settings: &TrainSettings,
        manifest: &Manifest,
        source: ScanSource,
        database: Database,
    ) -> DataLoader {
        let classes_m: Vec<_> = manifest.classes.iter().map(|c| c.size_m.map(f64::from)).collect();
        let wanted = |class: &AnchorClass| settings.setting.objects_wanted(&class.name);
        let augmentation = Augmentation {
            database: Arc::new(database),
            wanted: manifest.classes.iter().map(wanted).collect(),
            synthetic_unknown: settings.synthetic_unknown(),
            classes_m: classes_m.clone(),
            mirror_x: settings.setting != Setting::Kitti,
        };
        DataLoader {
            source,
            augmentation,
            manifest: manifest.clone(),
            classes_m,
            anchors: Anchors::of(manifest),
            planner: Planner::new(&manifest.network),
            background_cells: settings.background_cells(),
            batch: settings.batch,
            seed: settings.seed,
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

    /// A step's frames, and their labels except those of background cells.
    fn frames(&mut self, step: u64) -> Result<Vec<(LabelledScan, Targets)>, TrainError> {
        let mut frames = vec![];
        for number in 0..self.batch as u64 {
            let place = step * self.batch as u64 + number;
            let frame = self.frame_number(place);
            let any_sensor = self.source.input == VoxelInput::Local;
            let (mut scan, _) = self.source.changed(frame, |points| {
                if any_sensor {
                    thin(points, &mut Random::new(self.seed, &[4, place]));
                }
            })?;
            if any_sensor {
                scan.ignore_alike(&self.classes_m);
            }
            let random = &mut Random::new(self.seed, &[2, place]);
            self.augmentation.apply(&mut scan, random);
            crop(&mut scan, &self.manifest.network.grid);
            let targets = self.anchors.assign(&scan.objects);
            frames.push((scan, targets));
        }
        Ok(frames)
    }

    /// The batch of a step.
    pub fn prepare(&mut self, step: u64) -> Result<Batch, TrainError> {
        let frames = self.frames(step)?.into_iter();
        let (scans, mut targets): (Vec<_>, Vec<_>) = frames.map(|(s, t)| (s.points, t)).unzip();
        let plan = self.planner.plan(&scans);
        let network = &self.manifest.network;
        let [rows, columns] = network.map_shape();
        let cells = rows * columns;
        for (number, targets) in targets.iter_mut().enumerate() {
            let place = step * self.batch as u64 + number as u64;
            let first = (number * cells) as u32;
            let inside = first..first + cells as u32;
            let occupied = plan.map.occupied.iter().filter(|c| inside.contains(c));
            let occupied = occupied.map(|cell| cell - first).collect();
            self.label_background(occupied, targets, place);
        }
        let is_sigmoid = network.head == HeadKind::Sigmoid;
        let classes = if is_sigmoid { network.classes } else { 1 };
        let targets = BatchTargets::new(&targets, cells, self.anchors.per_cell(), classes);
        Ok(Batch { plan, targets })
    }

    /// The voxels and labels of a step's frames for [another trainer](crate::stream).
    pub(crate) fn prepare_bytes(&mut self, step: u64) -> Result<Vec<u8>, TrainError> {
        let mut bytes = vec![];
        for (scan, targets) in self.frames(step)? {
            stream::write_frame(self.planner.voxels(&scan.points), &targets, &mut bytes);
        }
        Ok(bytes)
    }

    /// Labels cells of a frame as background that have points (`occupied`) and no other label.
    fn label_background(&self, mut occupied: Vec<u32>, targets: &mut Targets, place: u64) {
        if self.background_cells == 0 {
            return;
        }
        let anchors = self.anchors.per_cell() as u32;
        let labelled = targets.cells.iter().map(|c| c.cell);
        let positive = targets.positives.iter().map(|p| p.cell);
        let ignored = targets.ignored.iter().map(|a| a / anchors);
        let taken: BTreeSet<u32> = labelled.chain(positive).chain(ignored).collect();
        occupied.retain(|cell| !taken.contains(cell));
        Random::new(self.seed, &[3, place]).shuffle(&mut occupied);
        occupied.truncate(self.background_cells);
        let weight = BACKGROUND_SHARE / occupied.len().max(1) as f32;
        let is = CellClass::Background;
        let background = |cell| CellLabel { cell, is, weight };
        targets.cells.extend(occupied.into_iter().map(background));
    }

    /// Batches of `steps` in order, made ahead by `prepare` on one thread for every four cores. The threads end when the queue is dropped.
    pub fn spawn<T: Send + 'static>(
        self,
        steps: std::ops::Range<u64>,
        prepare: fn(&mut DataLoader, u64) -> Result<T, TrainError>,
    ) -> BatchQueue<T> {
        let workers = rayon::current_num_threads().div_ceil(4);
        let spawn = |first: usize| {
            let (sender, receiver) = bounded(QUEUE);
            let (mut loader, steps) = (self.clone(), steps.clone().skip(first).step_by(workers));
            std::thread::spawn(move || {
                for step in steps {
                    let batch = prepare(&mut loader, step);
                    let failed = batch.is_err();
                    if sender.send(batch).is_err() || failed {
                        return;
                    }
                }
            });
            receiver
        };
        BatchQueue((0..workers).map(spawn).collect())
    }
}

/// Batches in the order of their steps; the threads supply them in rotation.
pub struct BatchQueue<T = Batch>(VecDeque<Receiver<Result<T, TrainError>>>);

impl<T> BatchQueue<T> {
    /// The next step's batch.
    pub fn take(&mut self, step: u64) -> Result<T, TrainError> {
        let ended = || format!("the thread that prepares batches ended before step {step}");
        let received = self.0.front().and_then(|queue| queue.recv().ok());
        self.0.rotate_left(1);
        received.ok_or_else(|| TrainError::Input(ended()))?
    }
}
