//! The memory of a frame, reused from frame to frame.

use crate::{candidates::Candidate, decode::Anchors, decode::BOX_CODES, vote::Votes};
use mluc_geometry::Box3;
use mluc_kernels::Gather;
use mluc_model::{HeadKind, Manifest};

#[derive(Clone, Debug, Default)]
pub(crate) struct Memory {
    pub(crate) every_row: Gather,
    /// A logit for each anchor and class; empty unless the head is a sigmoid head.
    pub(crate) class_logits: Vec<f32>,
    /// A logit for each anchor.
    pub(crate) logits: Vec<f32>,
    pub(crate) candidates: Vec<Candidate>,
    /// Rows with a candidate, ascending: the other heads run on these rows only.
    pub(crate) occupied: Gather,
    pub(crate) embeddings: Vec<f32>,
    /// A logit of the unknown for each occupied row, if the head has one.
    pub(crate) unknown: Vec<f32>,
    pub(crate) codes: Vec<f32>,
    pub(crate) directions: Vec<f32>,
    pub(crate) boxes: Vec<Box3>,
    pub(crate) order: Vec<usize>,
    /// Indices of the kept boxes, best first; class-agnostic boxes last.
    pub(crate) kept: Vec<usize>,
    pub(crate) generic: Vec<usize>,
    /// Position of a kept box in `kept`, and index of a box that it suppresses and that may vote for it.
    pub(crate) voters: Vec<(usize, usize)>,
    /// The votes for each kept box.
    pub(crate) votes: Vec<Votes>,
}

impl Memory {
    /// Memory for any frame of a checked manifest: a row for each cell of the map; every anchor can be a candidate before the best are selected.
    pub(crate) fn new(manifest: &Manifest) -> Memory {
        let network = &manifest.network;
        let cells: usize = network.map_shape().iter().product();
        let anchors = Anchors::new(manifest).per_cell();
        let candidates = manifest.thresholds.candidates_max as usize;
        // In the worst case each candidate lies in its own row.
        let closer = candidates.min(cells);
        let gather = |rows| Gather::new(1, Vec::with_capacity(rows));
        let values = |rows: usize, channels: usize| Vec::with_capacity(rows * channels);
        let has_class_logits = usize::from(network.head == HeadKind::Sigmoid);
        let class_logits = has_class_logits * anchors * network.classes;
        Memory {
            every_row: gather(cells),
            class_logits: values(cells, class_logits),
            logits: values(cells, anchors),
            candidates: Vec::with_capacity(cells * anchors),
            occupied: gather(candidates),
            embeddings: values(closer, network.classes),
            unknown: values(closer, 1),
            codes: values(closer, BOX_CODES * anchors),
            directions: values(closer, 2 * anchors),
            boxes: Vec::with_capacity(candidates),
            order: Vec::with_capacity(candidates),
            kept: Vec::with_capacity(candidates),
            generic: Vec::with_capacity(candidates),
            voters: Vec::with_capacity(candidates),
            votes: Vec::with_capacity(manifest.thresholds.boxes_max as usize),
        }
    }
}
