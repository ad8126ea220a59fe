//! Feature rows to detections: the stage as one function.

use mluc_geometry::Box3;
use mluc_ipc_types::{CLASSES_MAX, Detection};
use mluc_kernels::Gather;
use mluc_model::{Manifest, ModelError, Thresholds, WeightSet};

use crate::candidates::{Candidate, select, sigmoid};
use crate::convolutions::{RowHeads, read_all};
use crate::decode::{Anchors, BOX_CODES, decode, direct};
use crate::gate::gate;
use crate::prototypes::Prototypes;
use crate::suppress::{Suppression, Suppressor};

/// Why the head cannot run.
#[derive(Debug, thiserror::Error)]
pub enum HeadError {
    /// The model does not fit.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// Cells without a feature row would hold candidates that nobody sees.
    #[error(
        "model: an empty scene reaches objectness {empty_objectness_max}, which must be below objectness_min \
         {objectness_min}: raise the threshold or train further"
    )]
    FiresOnNothing {
        /// Of the manifest.
        empty_objectness_max: f32,
        /// Of the manifest.
        objectness_min: f32,
    },
    /// Cells and rows of other lengths.
    #[error("features: {expected} values for {cells} cells needed, {found} given")]
    Length {
        /// Cells given.
        cells: usize,
        /// cells x channels.
        expected: usize,
        /// Values given.
        found: usize,
    },
    /// A cell beyond the map.
    #[error("features: cells must be below {expected}, found {found}")]
    Cell {
        /// Cells of the map.
        expected: usize,
        /// The cell.
        found: u32,
    },
}

/// What a frame came to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HeadCounts {
    /// Anchors at or above `objectness_min`.
    pub candidates: u32,
    /// Of them left out beyond `candidates_max`.
    pub over_candidates_max: u32,
    /// Of them left out because their box or embedding is no number.
    pub non_finite: u32,
    /// Boxes kept.
    pub boxes: u32,
    /// `boxes_max` was reached: weaker boxes may have been left out.
    pub boxes_max_reached: bool,
}

/// The heads, the prototypes and the gate, with all memory of a frame.
#[derive(Clone, Debug)]
pub struct Head {
    heads: RowHeads,
    anchors: Anchors,
    prototypes: Prototypes,
    thresholds: Thresholds,
    suppression: Suppression,
    classes: usize,
    channels: usize,
    map_cells: usize,
    frame: Memory,
}

/// Of one frame.
#[derive(Clone, Debug, Default)]
struct Memory {
    every_row: Gather,
    logits: Vec<f32>,
    candidates: Vec<Candidate>,
    /// Rows that hold a candidate, ascending: the other heads run on these alone.
    occupied: Gather,
    embeddings: Vec<f32>,
    codes: Vec<f32>,
    directions: Vec<f32>,
    boxes: Vec<Box3>,
    suppressor: Suppressor,
}

impl Memory {
    /// For any frame of a checked manifest: a row for each cell of the map, every anchor a candidate until the best are
    /// picked.
    fn new(manifest: &Manifest) -> Memory {
        let network = &manifest.network;
        let cells: usize = network.map_shape().iter().product();
        let anchors = Anchors::new(manifest).per_cell();
        let candidates = manifest.thresholds.candidates_max as usize;
        // Each candidate lies in a row of its own at worst.
        let closer = candidates.min(cells);
        let gather = |rows| Gather {
            taps: 1,
            index: Vec::with_capacity(rows),
        };
        let values = |rows: usize, channels: usize| Vec::with_capacity(rows * channels);
        let [logits, embedding, code, direction] = network.heads().map(|(_, cout)| cout);
        Memory {
            every_row: gather(cells),
            logits: values(cells, logits),
            candidates: Vec::with_capacity(cells * anchors),
            occupied: gather(candidates),
            embeddings: values(closer, embedding),
            codes: values(closer, code),
            directions: values(closer, direction),
            boxes: Vec::with_capacity(candidates),
            suppressor: Suppressor::new(candidates),
        }
    }
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
    /// `detections` becomes the kept boxes, the best objectness first.
    pub fn run(
        &mut self,
        cells: &[u32],
        rows: &[f32],
        detections: &mut Vec<Detection>,
    ) -> Result<HeadCounts, HeadError> {
        self.check(cells, rows)?;
        detections.clear();
        let mut counts = self.find_candidates(rows);
        self.look_closer(rows);
        counts.non_finite = self.decode_boxes(cells);
        self.suppress();
        detections.extend(
            self.frame
                .suppressor
                .kept
                .iter()
                .map(|index| self.describe(*index, cells)),
        );
        counts.boxes = detections.len() as u32;
        counts.boxes_max_reached = counts.boxes == self.thresholds.boxes_max;
        Ok(counts)
    }

    /// What the four 1x1 convolutions give on every row, in the order of [`mluc_model::Network::heads`]: for tests
    /// against other implementations.
    pub fn outputs(&self, rows: &[f32]) -> [Vec<f32>; 4] {
        let mut every_row = Gather::default();
        read_all(&mut every_row, rows.len() / self.channels);
        [
            &self.heads.objectness,
            &self.heads.embedding,
            &self.heads.box_code,
            &self.heads.direction,
        ]
        .map(|head| {
            let mut output = vec![];
            head.run(rows, &every_row, &mut output);
            output
        })
    }

    /// The largest objectness over `rows`; of the empty scene's rows it is the manifest's `empty_objectness_max`.
    pub fn objectness_max(&self, rows: &[f32]) -> f32 {
        let [logits, ..] = self.outputs(rows);
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
        self.heads
            .objectness
            .run(rows, &frame.every_row, &mut frame.logits);
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
    fn look_closer(&mut self, rows: &[f32]) {
        let frame = &mut self.frame;
        frame.occupied.taps = 1;
        let occupied = &mut frame.occupied.index;
        occupied.clear();
        occupied.extend(frame.candidates.iter().map(|candidate| candidate.row));
        occupied.sort_unstable();
        occupied.dedup();
        self.heads
            .embedding
            .run(rows, &frame.occupied, &mut frame.embeddings);
        self.heads
            .box_code
            .run(rows, &frame.occupied, &mut frame.codes);
        self.heads
            .direction
            .run(rows, &frame.occupied, &mut frame.directions);
    }

    /// Boxes of the candidates. Those that are no numbers leave; gives how many.
    fn decode_boxes(&mut self, cells: &[u32]) -> u32 {
        let Memory {
            candidates,
            occupied,
            embeddings,
            codes,
            directions,
            boxes,
            ..
        } = &mut self.frame;
        let (anchors, classes) = (&self.anchors, self.classes);
        let before = candidates.len();
        boxes.clear();
        candidates.retain(|candidate| {
            let place = place(occupied, candidate.row);
            let slot = place * anchors.per_cell() + candidate.anchor as usize;
            let anchor = anchors.anchor(
                cells[candidate.row as usize] as usize,
                candidate.anchor as usize,
            );
            let code = &codes[slot * BOX_CODES..][..BOX_CODES];
            let decoded = decode(code, &anchor).filter(|_| {
                embeddings[place * classes..][..classes]
                    .iter()
                    .all(|value| value.is_finite())
            });
            let Some(mut found) = decoded else {
                return false;
            };
            let bin = usize::from(directions[slot * 2 + 1] > directions[slot * 2]);
            found.yaw_rad = direct(found.yaw_rad, bin);
            boxes.push(found);
            true
        });
        (before - candidates.len()) as u32
    }

    fn suppress(&mut self) {
        let Memory {
            candidates,
            boxes,
            suppressor,
            ..
        } = &mut self.frame;
        let class = |index: usize| Anchors::class(candidates[index].anchor as usize);
        let (iou_max, boxes_max) = (
            f64::from(self.thresholds.nms_iou),
            self.thresholds.boxes_max as usize,
        );
        suppressor.run(
            self.suppression,
            boxes,
            (class, self.classes),
            iou_max,
            boxes_max,
        );
    }

    /// Everything that is known of a kept box.
    fn describe(&self, index: usize, cells: &[u32]) -> Detection {
        let (candidate, found) = (self.frame.candidates[index], self.frame.boxes[index]);
        let place = place(&self.frame.occupied, candidate.row);
        let f = &self.frame.embeddings[place * self.classes..][..self.classes];
        let mut embedding = [0.0; CLASSES_MAX];
        embedding[..self.classes].copy_from_slice(f);
        let class = Anchors::class(candidate.anchor as usize);
        let scores = self.prototypes.scores(f);
        let threshold = self.thresholds.eds_normalised_max;
        Detection {
            center_m: found.center_m.map(|value| value as f32),
            size_m: found.size_m.map(|value| value as f32),
            yaw_rad: found.yaw_rad as f32,
            class_id: class as u32,
            kind: gate(scores.eds_normalised, threshold) as u32,
            cell: cells[candidate.row as usize],
            objectness: candidate.objectness,
            score: candidate.objectness * scores.probabilities[class],
            probabilities: scores.probabilities,
            embedding,
            eds: scores.eds,
            eds_normalised: scores.eds_normalised,
            eds_perpendicular: scores.eds_perpendicular,
            delta: scores.delta,
            softmax_max: scores.softmax_max,
            logit_max: scores.logit_max,
            energy: scores.energy,
            threshold,
        }
    }
}

/// Where a feature row stands among the occupied ones, which hold every candidate's row.
fn place(occupied: &Gather, row: u32) -> usize {
    occupied.index.partition_point(|other| *other < row)
}
