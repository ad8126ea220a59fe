//! One convolution with its folded batch norm and ReLU.

use mluc_kernels::{Epilogue, Gather, Weights, convolve};
use mluc_model::Folded;

/// Packed weights and bias.
#[derive(Clone, Debug)]
pub(crate) struct Convolution {
    weights: Weights,
    bias: Vec<f32>,
}

impl Convolution {
    /// All taps of a layer.
    pub(crate) fn new(layer: &Folded) -> Convolution {
        let weights = Weights::pack(layer.taps, layer.cin, layer.cout, &layer.weights);
        Convolution {
            weights,
            bias: layer.bias.clone(),
        }
    }

    /// One convolution a tap: a transposed layer, whose taps write different outputs.
    pub(crate) fn by_tap(layer: &Folded) -> Vec<Convolution> {
        let taps = layer.weights.chunks_exact(layer.cin * layer.cout);
        taps.map(|tap| Convolution {
            weights: Weights::pack(1, layer.cin, layer.cout, tap),
            bias: layer.bias.clone(),
        })
        .collect()
    }

    /// Channels of an output row.
    pub(crate) fn cout(&self) -> usize {
        self.weights.cout
    }

    /// Rows in, rows out; `output_rows` says where each goes (none: in order).
    pub(crate) fn run(
        &self,
        input: &[f32],
        gather: &Gather,
        output_rows: Option<&[u32]>,
        output: &mut [f32],
    ) {
        let epilogue = Epilogue {
            bias: Some(&self.bias),
            relu: true,
        };
        convolve(input, gather, &self.weights, epilogue, output_rows, output);
    }
}
