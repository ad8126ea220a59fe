//! Feature rows to detections: the stage as one function.

use crate::candidates::{Candidate, reduce_classes, select, sigmoid};
use crate::convolutions::{RowHead, RowHeads, read_all};
use crate::decode::{Anchors, BOX_CODES, decode, direct};
use crate::gate::{gate_by, is_unknown, threshold_of};
use crate::vote::{VOTE_IOU_MIN, Votes};
use crate::{HeadCounts, HeadError, memory::Memory, prototypes::Prototypes};
use mluc_geometry::{Box3, ground::ground_height_m, nms_into};
use mluc_ipc_types::{Detection, DetectionKind, GateKind, NO_PROBABILITY};
use mluc_kernels::Gather;
use mluc_model::{HeadKind, Manifest, Thresholds, WeightSet};

/// Embeddings and logits of this size or more get no scores, so that squares stay within f32.
const VALUE_MAX: f32 = 1e9;

/// The heads, the prototypes and the gate, with all memory of a frame.
#[derive(Clone, Debug)]
pub struct Head {
    heads: RowHeads,
    anchors: Anchors,
    prototypes: Prototypes,
    thresholds: Thresholds,
    kind: HeadKind,
    classes: usize,
    channels: usize,
    map_cells: usize,
    frame: Memory,
}

impl Head {
    /// Checks the model and packs its weights.
    pub fn new(manifest: &Manifest, weights: &WeightSet) -> Result<Head, HeadError> {
        manifest.validate()?;
        weights.check(&manifest.network)?;
        let empty_objectness_max = manifest.empty_objectness_max;
        let objectness_min = manifest.thresholds.objectness_min;
        if empty_objectness_max >= objectness_min {
            return Err(HeadError::FiresOnNothing { empty_objectness_max, objectness_min });
        }
        let network = &manifest.network;
        Ok(Head {
            heads: RowHeads::new(weights, network)?,
            anchors: Anchors::new(manifest),
            prototypes: Prototypes::new(network.classes, manifest.prototype_scale),
            thresholds: manifest.thresholds.clone(),
            kind: network.head,
            classes: network.classes,
            channels: network.feature_channels(),
            map_cells: network.map_shape().iter().product(),
            frame: Memory::new(manifest),
        })
    }

    /// Sets, from the next frame on, the threshold on the probability of the unknown, or without such a logit on the EDS.
    pub fn set_gate(&mut self, threshold: f32) {
        match self.kind {
            HeadKind::Open => self.thresholds.unknown_min = threshold,
            _ => self.thresholds.eds_normalised_max = threshold,
        }
    }

    /// Detects. `cells`: cell of the map (row * columns + column) of each row; `rows`: the channels, row after row. `detections` gets the kept boxes,
    /// each the mean of itself and its voters, best objectness first. For an open head, boxes of classes come first, then boxes of class-agnostic
    /// anchors: candidate unknowns if the probability of the unknown is at least `unknown_min` and one half, left out otherwise.
    pub fn run(
        &mut self,
        cells: &[u32],
        rows: &[f32],
        detections: &mut Vec<Detection>,
    ) -> Result<HeadCounts, HeadError> {
        self.check(cells, rows)?;
        detections.clear();
        let (candidates, damaged) = self.find_candidates(rows);
        let over_candidates_max = candidates - self.frame.candidates.len() as u32;
        self.run_candidate_heads(rows);
        self.drop_generic_on_known();
        let non_finite = damaged + self.decode_boxes(cells);
        self.suppress();
        self.vote();
        let boxes_max_reached = self.frame.kept.len() as u32 == self.thresholds.boxes_max;
        let kept = &self.frame.kept;
        let described = kept.iter().map(|index| self.describe(*index, cells));
        // Class-agnostic boxes can only be unknown. The threshold applies after the suppression, so that it always selects among the same boxes.
        let unknown_min = self.thresholds.unknown_min;
        let counts =
            |d: &Detection| d.has_class() || is_unknown(d.unknown_probability, unknown_min);
        detections.extend(described.filter(counts));
        Ok(HeadCounts { candidates, over_candidates_max, non_finite, boxes_max_reached })
    }

    /// The outputs of the 1x1 convolutions for every row, in the order of [`mluc_model::Network::heads`]; for tests against other implementations.
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

    /// The largest objectness over `rows`, or NaN if any is NaN; for the empty scene's rows it is the manifest's `empty_objectness_max`.
    pub fn objectness_max(&self, rows: &[f32]) -> f32 {
        let logits = self.outputs(rows).swap_remove(0).into_iter();
        // Removes the sign that a NaN may have: a negative NaN would sort first.
        logits.map(|logit| sigmoid(logit).abs()).max_by(f32::total_cmp).unwrap_or(0.0)
    }

    fn check(&self, cells: &[u32], rows: &[f32]) -> Result<(), HeadError> {
        let expected = cells.len() * self.channels;
        if rows.len() != expected {
            return Err(HeadError::Length { cells: cells.len(), expected, found: rows.len() });
        }
        match cells.iter().find(|cell| **cell as usize >= self.map_cells) {
            Some(&found) => Err(HeadError::Cell { expected: self.map_cells, found }),
            None => Ok(()),
        }
    }

    /// Computes the objectness of every anchor and selects the best; returns how many passed the threshold, and how many are NaN.
    fn find_candidates(&mut self, rows: &[f32]) -> (u32, u32) {
        let (frame, thresholds) = (&mut self.frame, &self.thresholds);
        read_all(&mut frame.every_row, rows.len() / self.channels);
        let presence = &self.heads.presence;
        if self.kind == HeadKind::Sigmoid {
            presence.run(rows, &frame.every_row, &mut frame.class_logits);
            reduce_classes(&frame.class_logits, self.classes, &mut frame.logits);
        } else {
            presence.run(rows, &frame.every_row, &mut frame.logits);
        }
        let (found, damaged) = select(
            &frame.logits,
            self.anchors.per_cell(),
            thresholds.objectness_min,
            thresholds.candidates_max as usize,
            &mut frame.candidates,
        );
        (found as u32, damaged as u32)
    }

    /// Computes embedding, box, direction and logit of the unknown for the rows with a candidate.
    fn run_candidate_heads(&mut self, rows: &[f32]) {
        let frame = &mut self.frame;
        frame.occupied.taps = 1;
        let occupied = &mut frame.occupied.index;
        occupied.clear();
        occupied.extend(frame.candidates.iter().map(|candidate| candidate.row));
        occupied.sort_unstable();
        occupied.dedup();
        for candidate in &mut frame.candidates {
            candidate.place = occupied.partition_point(|row| *row < candidate.row) as u32;
        }
        let (heads, which) = (&self.heads, &frame.occupied);
        if let Some(embedding) = &heads.embedding {
            embedding.run(rows, which, &mut frame.embeddings);
        }
        heads.box_code.run(rows, which, &mut frame.codes);
        heads.direction.run(rows, which, &mut frame.directions);
        if let Some(unknown) = &heads.unknown {
            unknown.run(rows, which, &mut frame.unknown);
            for candidate in &mut frame.candidates {
                candidate.unknown = Some(frame.unknown[candidate.place as usize]);
            }
        }
    }

    /// Removes candidates of class-agnostic anchors in cells with a known object, which has anchors of its class.
    fn drop_generic_on_known(&mut self) {
        let is_known = |c: &Candidate| c.unknown.is_some_and(|logit| logit <= 0.0);
        let candidates = &mut self.frame.candidates;
        candidates.retain(|c| c.class() < self.classes || !is_known(c));
    }

    /// The values from which a candidate's scores are computed: its cell's embedding, or its anchor's class logits.
    fn embedding(&self, candidate: &Candidate) -> &[f32] {
        let (frame, anchors) = (&self.frame, self.anchors.per_cell());
        let anchor = candidate.row as usize * anchors + candidate.anchor as usize;
        let (values, place) = match self.kind {
            HeadKind::Sigmoid => (&frame.class_logits, anchor),
            _ => (&frame.embeddings, candidate.place as usize),
        };
        &values[place * self.classes..][..self.classes]
    }

    /// Decodes the boxes of the candidates. Removes candidates with values that are NaN or too large, and returns how many.
    fn decode_boxes(&mut self, cells: &[u32]) -> u32 {
        let mut candidates = std::mem::take(&mut self.frame.candidates);
        let mut boxes = std::mem::take(&mut self.frame.boxes);
        let before = candidates.len();
        boxes.clear();
        candidates.retain(|candidate| {
            let found = self.decode_box(candidate, cells);
            boxes.extend(found);
            found.is_some()
        });
        let dropped = before - candidates.len();
        (self.frame.candidates, self.frame.boxes) = (candidates, boxes);
        dropped as u32
    }

    fn decode_box(&self, candidate: &Candidate, cells: &[u32]) -> Option<Box3> {
        let (frame, anchor) = (&self.frame, candidate.anchor as usize);
        let slot = candidate.place as usize * self.anchors.per_cell() + anchor;
        let cell = cells[candidate.row as usize] as usize;
        let at = self.anchors.anchor(cell, anchor);
        let mut found = decode(&frame.codes[slot * BOX_CODES..][..BOX_CODES], &at)?;
        let bins = &frame.directions[slot * 2..][..2];
        found.yaw_rad = direct(found.yaw_rad, usize::from(bins[1] > bins[0]));
        let mut values = self.embedding(candidate).iter().chain(&candidate.unknown);
        // False for NaN.
        values.all(|value| value.abs() < VALUE_MAX).then_some(found)
    }

    /// Non-maximum suppression over all boxes of any class, then over the class-agnostic boxes, which only suppress each other and come last.
    /// A suppressed box that overlaps its kept box by [`VOTE_IOU_MIN`] or more may vote for it; [`Votes::add`] decides whether it does.
    fn suppress(&mut self) {
        let (frame, thresholds) = (&mut self.frame, &self.thresholds);
        let (candidates, boxes) = (&frame.candidates, &frame.boxes);
        let (iou_max, boxes_max) = (thresholds.nms_iou.into(), thresholds.boxes_max as usize);
        let has_class = |index: &usize| candidates[*index].class() < self.classes;
        let (order, kept, generic) = (&mut frame.order, &mut frame.kept, &mut frame.generic);
        let voters = &mut frame.voters;
        voters.clear();
        let mut poll = |number: usize, index: usize, iou: f64| {
            if iou >= VOTE_IOU_MIN {
                voters.push((number, index));
            }
        };
        order.clear();
        order.extend((0..boxes.len()).filter(has_class));
        nms_into(boxes, order, iou_max, boxes_max, kept, &mut poll);
        order.clear();
        order.extend((0..boxes.len()).filter(|index| !has_class(index)));
        let (first, left) = (kept.len(), boxes_max - kept.len());
        let poll_generic = |number: usize, index, iou| poll(first + number, index, iou);
        nms_into(boxes, order, iou_max, left, generic, poll_generic);
        kept.extend_from_slice(generic);
    }

    /// Replaces every kept box and its logit of the unknown by the mean over its voters.
    fn vote(&mut self) {
        let frame = &mut self.frame;
        let (candidates, boxes) = (&mut frame.candidates, &mut frame.boxes);
        let votes = &mut frame.votes;
        votes.clear();
        let of = |best: &usize| Votes::of(&candidates[*best], &boxes[*best]);
        votes.extend(frame.kept.iter().map(of));
        for &(number, index) in &frame.voters {
            votes[number].add(&candidates[index], &boxes[index]);
        }
        for (best, votes) in frame.kept.iter().zip(votes) {
            (boxes[*best], candidates[*best].unknown) = votes.mean();
        }
    }

    fn describe(&self, index: usize, cells: &[u32]) -> Detection {
        let (candidate, found) = (&self.frame.candidates[index], &self.frame.boxes[index]);
        let f = self.embedding(candidate);
        let unknown = candidate.unknown.map(sigmoid);
        let (mut scores, own) = (self.scores(f), candidate.class());
        let has_class = own < self.classes;
        let (class, share) = match self.kind {
            HeadKind::Sigmoid => (largest(f), 1.0),
            _ if has_class => (own, scores.probabilities[own]),
            // The share of a class-agnostic box is its probability of being none of the known classes.
            _ => (largest(f), unknown.unwrap_or(0.0)),
        };
        let (kind, gate) = if has_class {
            gate_by(&scores, unknown, &self.thresholds)
        } else {
            // Its probability of the unknown alone makes it a candidate.
            scores.probabilities.fill(0.0);
            (DetectionKind::Candidate, GateKind::UnknownProbability)
        };
        Detection {
            center_m: found.center_m.map(|value| value as f32),
            size_m: found.size_m.map(|value| value as f32),
            yaw_rad: found.yaw_rad as f32,
            class_id: class as u32,
            kind: kind as u32,
            cell: cells[candidate.row as usize],
            objectness: candidate.objectness,
            score: candidate.objectness * share,
            unknown_probability: unknown.unwrap_or(NO_PROBABILITY),
            gate: gate as u32,
            threshold: threshold_of(gate, &self.thresholds),
            ..scores
        }
    }

    /// Every score of an embedding or of class logits; a sigmoid head has an independent probability for each class.
    fn scores(&self, f: &[f32]) -> Detection {
        let mut scores = self.prototypes.scores(f);
        if self.kind == HeadKind::Sigmoid {
            scores.probabilities.iter_mut().zip(f).for_each(|(p, logit)| *p = sigmoid(*logit));
            scores.softmax_max = scores.probabilities.iter().copied().fold(0.0, f32::max);
        }
        scores
    }
}

impl Candidate {
    /// Its anchor's class; numbers beyond the classes are class-agnostic sizes.
    pub(crate) fn class(&self) -> usize {
        Anchors::class(self.anchor as usize)
    }
}

/// Converts boxes with z above the ground of a scan (see [`mluc_geometry::ground`]) to the sensor frame. No change if `ground_m`
/// is empty: the boxes of a network whose input is not local are already in the sensor frame.
pub fn stand_on_ground(detections: &mut [Detection], ground_m: &[f32]) {
    if ground_m.is_empty() {
        return;
    }
    for detection in detections {
        let [x, y, z] = &mut detection.center_m;
        *z += ground_height_m(ground_m, [*x, *y]);
    }
}

/// Index of the largest value, the first of equal ones.
fn largest(values: &[f32]) -> usize {
    let better = |best: usize, i: usize| if values[i] > values[best] { i } else { best };
    (0..values.len()).fold(0, better)
}
