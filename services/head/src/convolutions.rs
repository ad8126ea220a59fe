//! The four 1x1 convolutions on feature rows (paper section 3.2).

use mluc_kernels::{Epilogue, Gather, Weights, convolve};
use mluc_model::{Folded, ModelError, Network, WeightSet};

/// One head.
#[derive(Clone, Debug)]
pub(crate) struct RowHead {
    weights: Weights,
    bias: Vec<f32>,
}

impl RowHead {
    fn new(
        weights: &WeightSet,
        network: &Network,
        name: &str,
        cout: usize,
    ) -> Result<RowHead, ModelError> {
        let folded = Folded::head(weights, network, name, cout)?;
        let weights = Weights::pack(1, folded.cin, folded.cout, &folded.weights);
        Ok(RowHead {
            weights,
            bias: folded.bias,
        })
    }

    /// `output`: one row of the head's channels for each row number in `which`.
    pub(crate) fn run(&self, rows: &[f32], which: &Gather, output: &mut Vec<f32>) {
        // Every value is overwritten.
        output.resize(which.outputs() * self.weights.cout, 0.0);
        let epilogue = Epilogue {
            bias: Some(&self.bias),
            relu: false,
        };
        convolve(rows, which, &self.weights, epilogue, None, output);
    }
}

/// Objectness (a logit an anchor), embedding (C values), box (7 codes an anchor), direction (2 logits an anchor).
#[derive(Clone, Debug)]
pub(crate) struct RowHeads {
    pub(crate) objectness: RowHead,
    pub(crate) embedding: RowHead,
    pub(crate) box_code: RowHead,
    pub(crate) direction: RowHead,
}

impl RowHeads {
    pub(crate) fn new(weights: &WeightSet, network: &Network) -> Result<RowHeads, ModelError> {
        let [objectness, embedding, box_code, direction] = network
            .heads()
            .map(|(name, cout)| RowHead::new(weights, network, name, cout));
        Ok(RowHeads {
            objectness: objectness?,
            embedding: embedding?,
            box_code: box_code?,
            direction: direction?,
        })
    }
}

/// A gather that reads rows 0 to `rows`.
pub(crate) fn read_all(which: &mut Gather, rows: usize) {
    which.taps = 1;
    which.index.truncate(rows);
    which.index.extend(which.index.len() as u32..rows as u32);
}
