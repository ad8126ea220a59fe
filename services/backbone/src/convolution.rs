//! One convolution with its folded batch norm and ReLU.

use mluc_kernels::{Element, Epilogue, Gather};
use mluc_model::Folded;

use crate::backbone::BackboneError;
use crate::precision::Value;

/// Packed weights and bias of a layer that reads rows of `V`.
#[derive(Clone, Debug)]
pub(crate) struct Convolution<V: Value> {
    weights: V::Weights,
    bias: Vec<f32>,
}

impl<V: Value> Convolution<V> {
    /// All taps of a layer, in the units of the rows that it reads and writes.
    pub(crate) fn new(layer: &Folded) -> Result<Convolution<V>, BackboneError> {
        Ok(Convolution {
            weights: V::pack(layer.taps, layer.cin, layer.cout, &layer.weights)?,
            bias: layer.bias.clone(),
        })
    }

    /// One convolution a tap: a transposed layer, whose taps write different outputs.
    pub(crate) fn by_tap(layer: &Folded) -> Result<Vec<Convolution<V>>, BackboneError> {
        let taps = layer.weights.chunks_exact(layer.cin * layer.cout);
        taps.map(|tap| {
            Ok(Convolution {
                weights: V::pack(1, layer.cin, layer.cout, tap)?,
                bias: layer.bias.clone(),
            })
        })
        .collect()
    }

    /// Channels of an output row.
    pub(crate) fn cout(&self) -> usize {
        self.bias.len()
    }

    /// Rows in, rows out; `output_rows` says where each goes (none: in order).
    pub(crate) fn run<O: Element>(
        &self,
        input: &[V],
        gather: &Gather,
        output_rows: Option<&[u32]>,
        output: &mut [O],
    ) {
        let epilogue = Epilogue {
            bias: Some(&self.bias),
            relu: true,
        };
        V::convolve(input, gather, &self.weights, epilogue, output_rows, output);
    }
}
