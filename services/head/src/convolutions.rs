//! The 1x1 convolutions on feature rows (paper section 3.2).

use mluc_kernels::{Epilogue, Gather, Weights, convolve};
use mluc_model::{Folded, HeadKind, ModelError, Network, WeightSet};

#[derive(Clone, Debug)]
pub(crate) struct RowHead {
    weights: Weights,
    bias: Vec<f32>,
}

impl RowHead {
    /// `output`: one row of the head's channels for each row number in `which`.
    pub(crate) fn run(&self, rows: &[f32], which: &Gather, output: &mut Vec<f32>) {
        // Every value is overwritten.
        output.resize(which.outputs() * self.weights.cout, 0.0);
        let epilogue = Epilogue { bias: Some(&self.bias), relu: false };
        convolve(rows, which, &self.weights, epilogue, None, output);
    }
}

/// The heads: presence, embedding (C values), box (7 codes per anchor), direction (2 logits per anchor), and the logit of the unknown.
#[derive(Clone, Debug)]
pub(crate) struct RowHeads {
    /// Decides whether an anchor is a candidate: objectness (one logit per anchor) or, for a sigmoid head, one logit per anchor and class.
    pub(crate) presence: RowHead,
    pub(crate) embedding: Option<RowHead>,
    pub(crate) box_code: RowHead,
    pub(crate) direction: RowHead,
    pub(crate) unknown: Option<RowHead>,
}

impl RowHeads {
    pub(crate) fn new(weights: &WeightSet, network: &Network) -> Result<RowHeads, ModelError> {
        let has = |name: &str| network.heads().iter().any(|(other, _)| *other == name);
        let (anchors, classes) = (network.anchors(), network.classes);
        let head = |name: &str, cout: usize| {
            let folded = Folded::head(weights, network, name, cout)?;
            Ok::<_, ModelError>(RowHead {
                weights: Weights::pack(1, folded.cin, folded.cout, &folded.weights),
                bias: folded.bias,
            })
        };
        let where_there = |name: &str, cout: usize| has(name).then(|| head(name, cout)).transpose();
        let presence = match network.head {
            HeadKind::Sigmoid => head("head.class", anchors * classes)?,
            _ => head("head.objectness", anchors)?,
        };
        Ok(RowHeads {
            presence,
            embedding: where_there("head.embedding", classes)?,
            box_code: head("head.box", 7 * anchors)?,
            direction: head("head.direction", 2 * anchors)?,
            unknown: where_there("head.unknown", 1)?,
        })
    }

    /// The heads in the order of [`Network::heads`].
    pub(crate) fn in_order(&self) -> impl Iterator<Item = &RowHead> {
        let first = [&self.presence].into_iter().chain(&self.embedding);
        first.chain([&self.box_code, &self.direction]).chain(&self.unknown)
    }
}

/// Sets `which` to a gather that reads the first `rows` rows.
pub(crate) fn read_all(which: &mut Gather, rows: usize) {
    which.taps = 1;
    which.index.truncate(rows);
    which.index.extend(which.index.len() as u32..rows as u32);
}
