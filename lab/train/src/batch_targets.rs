//! The labels of a batch, by row of the cells on which the heads run.

use crate::targets::{CellClass, CellLabel, Targets};

/// Labels of a batch.
#[derive(Clone, Debug, Default)]
pub struct BatchTargets {
    /// For each anchor of the batch (for a sigmoid head: each anchor and class): 1 positive, 0 negative, -1 ignored.
    pub labels: Vec<i8>,
    /// Cells with a positive anchor or a class, over the batch, ascending.
    pub labelled: Vec<u32>,
    /// 1 / (frames * positives) of each frame.
    pub(crate) frame_weight: Vec<f32>,
    pub(crate) positives: Vec<RowPositive>,
    pub(crate) cells: Vec<RowClass>,
}

/// A positive anchor, by row of the labelled cells.
#[derive(Clone, Debug)]
pub(crate) struct RowPositive {
    pub(crate) row: u32,
    pub(crate) anchor: u32,
    pub(crate) codes: [f32; 7],
    pub(crate) bin: u8,
    pub(crate) weight: f32,
}

/// A class, by row of the labelled cells.
#[derive(Clone, Debug)]
pub(crate) struct RowClass {
    pub(crate) row: u32,
    pub(crate) is: CellClass,
    pub(crate) weight: f32,
    /// 1 / (frames * labelled cells of its frame).
    pub(crate) share: f32,
}

impl BatchTargets {
    /// Joins frames. `cells`: cells of one frame's map; `anchors`: anchors per cell; `classes`: logits per anchor, 1 except for a sigmoid head.
    pub fn new(frames: &[Targets], cells: usize, anchors: usize, classes: usize) -> BatchTargets {
        let mut batch = BatchTargets::default();
        let mut all = vec![0; frames.len() * cells * anchors * classes];
        let labels = all.chunks_exact_mut(cells * anchors * classes);
        for (number, (targets, labels)) in frames.iter().zip(labels).enumerate() {
            for &anchor in &targets.ignored {
                labels[anchor as usize * classes..][..classes].fill(-1);
            }
            let mut used: Vec<u32> = targets.cells.iter().map(|c| c.cell).collect();
            used.extend(targets.positives.iter().map(|p| p.cell));
            used.sort_unstable();
            used.dedup();
            let base = batch.labelled.len();
            let row = |cell: u32| (base + used.binary_search(&cell).unwrap_or(0)) as u32;
            let weight = 1.0 / (frames.len() * targets.positives.len().max(1)) as f32;
            for p in &targets.positives {
                let at = p.cell as usize * anchors + p.anchor as usize;
                // An anchor belongs to one class: its logits for the other classes have to be low.
                let own = (p.anchor as usize / 2) % classes;
                labels[at * classes..][..classes].fill(0);
                labels[at * classes + own] = 1;
                batch.positives.push(RowPositive {
                    row: row(p.cell),
                    anchor: p.anchor,
                    codes: p.codes,
                    bin: p.bin,
                    weight,
                });
            }
            let is_object = |c: &&CellLabel| c.is != CellClass::Background;
            let objects = targets.cells.iter().filter(is_object).count();
            batch.cells.extend(targets.cells.iter().map(|c| RowClass {
                row: row(c.cell),
                is: c.is,
                weight: c.weight / frames.len() as f32,
                share: 1.0 / (frames.len() * objects.max(1)) as f32,
            }));
            batch.frame_weight.push(weight);
            let first = (number * cells) as u32;
            batch.labelled.extend(used.iter().map(|cell| first + cell));
        }
        batch.labels = all;
        batch
    }
}
