//! Feature rows to detections: the stage as one function.

use mluc_geometry::Box3;
use mluc_ipc_types::{CLASSES_MAX, Detection, NO_PROBABILITY};
use mluc_kernels::Gather;
use mluc_model::{HeadKind, Manifest, Thresholds, WeightSet};

use crate::candidates::{reduce_classes, select, sigmoid};
use crate::convolutions::{RowHead, RowHeads, read_all};
use crate::decode::{Anchors, BOX_CODES, decode, direct};
use crate::gate::{Decision, gate_by, is_unknown};
use crate::memory::Memory;
use crate::prototypes::{Prototypes, Scores};
use crate::report::{HeadCounts, HeadError};
use crate::suppress::Suppression;

/// The heads, the prototypes and the gate, with all memory of a frame.
#[derive(Clone, Debug)]
pub struct Head {
    heads: RowHeads,
    anchors: Anchors,
    prototypes: Prototypes,
    thresholds: Thresholds,
    suppression: Suppression,
    kind: HeadKind,
    classes: usize,
    channels: usize,
    map_cells: usize,
    frame: Memory,
}

impl Head {
    /// Checks the model and packs its weights. Suppression is [`Suppression::Agnostic`].
    pub fn new(manifest: &Manifest, weights: &WeightSet) -> Result<Head, HeadError> {
        manifest.validate()?;
        weights.check(&manifest.network)?;
        let (empty_objectness_max, objectness_min) = (
            manifest.empty_objectness_max,
            manifest.thresholds.objectness_min,
        );
        if empty_objectness_max >= objectness_min {
            return Err(HeadError::FiresOnNothing {
                empty_objectness_max,
                objectness_min,
            });
        }
        let network = &manifest.network;
        Ok(Head {
            heads: RowHeads::new(weights, network)?,
            anchors: Anchors::new(manifest),
            prototypes: Prototypes::new(network.classes, manifest.prototype_scale),
            thresholds: manifest.thresholds.clone(),
            suppression: Suppression::default(),
            kind: network.head,
            classes: network.classes,
            channels: network.feature_channels(),
            map_cells: network.map_shape().iter().product(),
            frame: Memory::new(manifest),
        })
    }

    /// The same head with another kind of suppression.
    pub fn with_suppression(self, suppression: Suppression) -> Head {
        Head {
            suppression,
            ..self
        }
    }

    /// Detects. `cells`: cell of the map (row * columns + column) of each row; `rows`: the channels, row after row.
    /// `detections` becomes the kept boxes, the best objectness first; of an open head those of classes, then those of
    /// anchors without a class, which are candidate unknowns from the threshold `unknown_min` on and left out below.
    pub fn run(
        &mut self,
        cells: &[u32],
        rows: &[f32],
        detections: &mut Vec<Detection>,
    ) -> Result<HeadCounts, HeadError> {
        self.check(cells, rows)?;
        detections.clear();
        let mut counts = self.find_candidates(rows);
        self.run_candidate_heads(rows);
        counts.generic_known = self.drop_generic_on_known();
        counts.non_finite = self.decode_boxes(cells);
        counts.generic = self.suppress();
        let kept = self.frame.suppressor.kept.len() as u32;
        counts.boxes_max_reached = kept == self.thresholds.boxes_max;
        let doubted = self.drop_doubted_generic(counts.generic as usize);
        counts.generic -= doubted;
        counts.generic_known += doubted;
        let kept = self.frame.suppressor.kept.iter();
        detections.extend(kept.map(|index| self.describe(*index, cells)));
        counts.boxes = detections.len() as u32;
        Ok(counts)
    }

    /// What the 1x1 convolutions give on every row, in the order of [`mluc_model::Network::heads`]: for tests against
    /// other implementations.
    pub fn outputs(&self, rows: &[f32]) -> Vec<Vec<f32>> {
        let mut every_row = Gather::default();
        read_all(&mut every_row, rows.len() / self.channels);
        let output = |head: &RowHead| {
            let mut output = vec![];
            head.run(rows, &every_row, &mut output);
            output
        };
        self.heads.in_order().map(output).collect()
    }

    /// The largest objectness over `rows`; of the empty scene's rows it is the manifest's `empty_objectness_max`.
    pub fn objectness_max(&self, rows: &[f32]) -> f32 {
        let logits = self.outputs(rows).swap_remove(0);
        logits.into_iter().map(sigmoid).fold(0.0, f32::max)
    }

    fn check(&self, cells: &[u32], rows: &[f32]) -> Result<(), HeadError> {
        let expected = cells.len() * self.channels;
        if rows.len() != expected {
            return Err(HeadError::Length {
                cells: cells.len(),
                expected,
                found: rows.len(),
            });
        }
        match cells.iter().find(|cell| **cell as usize >= self.map_cells) {
            Some(&found) => Err(HeadError::Cell {
                expected: self.map_cells,
                found,
            }),
            None => Ok(()),
        }
    }

    /// Objectness of every anchor, and the best of them.
    fn find_candidates(&mut self, rows: &[f32]) -> HeadCounts {
        let (frame, thresholds) = (&mut self.frame, &self.thresholds);
        read_all(&mut frame.every_row, rows.len() / self.channels);
        let presence = &self.heads.presence;
        if self.kind == HeadKind::Sigmoid {
            presence.run(rows, &frame.every_row, &mut frame.class_logits);
            reduce_classes(&frame.class_logits, self.classes, &mut frame.logits);
        } else {
            presence.run(rows, &frame.every_row, &mut frame.logits);
        }
        let found = select(
            &frame.logits,
            self.anchors.per_cell(),
            thresholds.objectness_min,
            thresholds.candidates_max as usize,
            &mut frame.candidates,
        );
        HeadCounts {
            candidates: found as u32,
            over_candidates_max: (found - frame.candidates.len()) as u32,
            ..HeadCounts::default()
        }
    }

    /// Embedding, box and direction of the rows that hold a candidate.
    fn run_candidate_heads(&mut self, rows: &[f32]) {
        let frame = &mut self.frame;
        frame.occupied.taps = 1;
        let occupied = &mut frame.occupied.index;
        occupied.clear();
        occupied.extend(frame.candidates.iter().map(|candidate| candidate.row));
        occupied.sort_unstable();
        occupied.dedup();
        let (heads, which) = (&self.heads, &frame.occupied);
        if let Some(embedding) = &heads.embedding {
            embedding.run(rows, which, &mut frame.embeddings);
        }
        heads.box_code.run(rows, which, &mut frame.codes);
        heads.direction.run(rows, which, &mut frame.directions);
        if let Some(unknown) = &heads.unknown {
            unknown.run(rows, which, &mut frame.unknown);
        }
    }

    /// Takes out candidates of anchors without a class in cells that hold a known object; gives how many.
    fn drop_generic_on_known(&mut self) -> u32 {
        if self.kind != HeadKind::Open {
            return 0;
        }
        let Memory {
            candidates,
            occupied,
            unknown,
            ..
        } = &mut self.frame;
        let before = candidates.len();
        let is_known = |row: u32| unknown[place(occupied, row)] <= 0.0;
        candidates.retain(|c| Anchors::class(c.anchor as usize) < self.classes || !is_known(c.row));
        (before - candidates.len()) as u32
    }

    /// The values that the scores of a candidate are made of: its cell's embedding, or its anchor's class logits.
    fn embedding<'a>(&self, frame: &'a Memory, row: u32, anchor: u32) -> &'a [f32] {
        let first = match self.kind {
            HeadKind::Sigmoid => {
                let slot = row as usize * self.anchors.per_cell() + anchor as usize;
                return &frame.class_logits[slot * self.classes..][..self.classes];
            }
            _ => place(&frame.occupied, row) * self.classes,
        };
        &frame.embeddings[first..][..self.classes]
    }

    /// Boxes of the candidates. Those that are no numbers leave; gives how many.
    fn decode_boxes(&mut self, cells: &[u32]) -> u32 {
        let mut frame = std::mem::take(&mut self.frame);
        let before = frame.candidates.len();
        let mut candidates = std::mem::take(&mut frame.candidates);
        frame.boxes.clear();
        candidates.retain(|candidate| {
            let found = self.decode_box(&frame, candidate.row, candidate.anchor, cells);
            let Some(found) = found else {
                return false;
            };
            frame.boxes.push(found);
            true
        });
        let dropped = before - candidates.len();
        frame.candidates = candidates;
        self.frame = frame;
        dropped as u32
    }

    fn decode_box(&self, frame: &Memory, row: u32, anchor: u32, cells: &[u32]) -> Option<Box3> {
        let slot = place(&frame.occupied, row) * self.anchors.per_cell() + anchor as usize;
        let at = self
            .anchors
            .anchor(cells[row as usize] as usize, anchor as usize);
        let mut found = decode(&frame.codes[slot * BOX_CODES..][..BOX_CODES], &at)?;
        let values = self.embedding(frame, row, anchor);
        let bins = &frame.directions[slot * 2..][..2];
        found.yaw_rad = direct(found.yaw_rad, usize::from(bins[1] > bins[0]));
        values
            .iter()
            .all(|value| value.is_finite())
            .then_some(found)
    }

    /// Keeps the best boxes; gives how many of the kept have no class.
    fn suppress(&mut self) -> u32 {
        let mut frame = std::mem::take(&mut self.frame);
        let mut suppressor = std::mem::take(&mut frame.suppressor);
        let group = |index: usize| {
            let candidate = &frame.candidates[index];
            self.group(&frame, candidate.row, candidate.anchor)
        };
        let (iou_max, boxes_max) = (
            f64::from(self.thresholds.nms_iou),
            self.thresholds.boxes_max as usize,
        );
        let (mode, classes, boxes) = (self.suppression, self.classes, &frame.boxes);
        let generic = suppressor.run(mode, boxes, (group, classes), iou_max, boxes_max);
        frame.suppressor = suppressor;
        self.frame = frame;
        generic as u32
    }

    /// Takes out kept boxes without a class that the gate does not hold for unknown: they have no class to be known by. The
    /// last `generic` of the kept are such; gives how many go. They have had their say in the suppression, so that the
    /// threshold chooses among the same boxes whatever it is.
    fn drop_doubted_generic(&mut self, generic: usize) -> u32 {
        let unknown_min = self.thresholds.unknown_min;
        let Memory {
            candidates,
            occupied,
            unknown,
            suppressor,
            ..
        } = &mut self.frame;
        let kept = &mut suppressor.kept;
        let (before, first) = (kept.len(), kept.len() - generic);
        let mut at = 0..before;
        kept.retain(|&index| {
            let has_class = at.next().is_some_and(|at| at < first);
            let logit = unknown.get(place(occupied, candidates[index].row));
            has_class || logit.is_some_and(|logit| is_unknown(sigmoid(*logit), unknown_min))
        });
        (before - kept.len()) as u32
    }

    /// The class that a candidate is of; that of the classes' count has none.
    fn group(&self, frame: &Memory, row: u32, anchor: u32) -> usize {
        match self.kind {
            HeadKind::Sigmoid => largest(self.embedding(frame, row, anchor)),
            _ => Anchors::class(anchor as usize).min(self.classes),
        }
    }

    /// Everything that is known of a kept box.
    fn describe(&self, index: usize, cells: &[u32]) -> Detection {
        let (frame, thresholds) = (&self.frame, &self.thresholds);
        let (candidate, found) = (frame.candidates[index], frame.boxes[index]);
        let f = self.embedding(frame, candidate.row, candidate.anchor);
        let mut embedding = [0.0; CLASSES_MAX];
        embedding[..self.classes].copy_from_slice(f);
        let logit = frame.unknown.get(place(&frame.occupied, candidate.row));
        let logit = logit.filter(|_| self.kind == HeadKind::Open);
        let unknown = logit.map(|logit| sigmoid(*logit));
        let scores = self.scores(f);
        let group = self.group(frame, candidate.row, candidate.anchor);
        let class = if group < self.classes {
            group
        } else {
            largest(f)
        };
        let decision = if group < self.classes {
            gate_by(&scores, unknown, thresholds)
        } else {
            Decision::of_generic(thresholds)
        };
        // A generic box is as sure as its being of no class.
        let share = match self.kind {
            HeadKind::Sigmoid => 1.0,
            _ if group < self.classes => scores.probabilities[class],
            _ => unknown.unwrap_or(0.0),
        };
        Detection {
            center_m: found.center_m.map(|value| value as f32),
            size_m: found.size_m.map(|value| value as f32),
            yaw_rad: found.yaw_rad as f32,
            class_id: class as u32,
            kind: decision.kind as u32,
            cell: cells[candidate.row as usize],
            objectness: candidate.objectness,
            score: candidate.objectness * share,
            probabilities: scores.probabilities,
            embedding,
            eds: scores.eds,
            eds_normalised: scores.eds_normalised,
            eds_perpendicular: scores.eds_perpendicular,
            delta: scores.delta,
            softmax_max: scores.softmax_max,
            logit_max: scores.logit_max,
            energy: scores.energy,
            unknown_probability: unknown.unwrap_or(NO_PROBABILITY),
            gate: decision.gate as u32,
            threshold: decision.threshold,
        }
    }

    /// Every score of an embedding or of class logits; a sigmoid head's probabilities are those of each class alone.
    fn scores(&self, f: &[f32]) -> Scores {
        let mut scores = self.prototypes.scores(f);
        if self.kind == HeadKind::Sigmoid {
            let pairs = scores.probabilities.iter_mut().zip(f);
            pairs.for_each(|(p, logit)| *p = sigmoid(*logit));
            scores.softmax_max = scores.probabilities.iter().copied().fold(0.0, f32::max);
        }
        scores
    }
}

/// Index of the largest value, the first of equal ones.
fn largest(values: &[f32]) -> usize {
    let better = |best: usize, i: usize| if values[i] > values[best] { i } else { best };
    (0..values.len()).fold(0, better)
}

/// Where a feature row stands among the occupied ones, which hold every candidate's row.
fn place(occupied: &Gather, row: u32) -> usize {
    occupied.index.partition_point(|other| *other < row)
}
