//! One convolution with its folded batch norm and ReLU.

use crate::precision::Value;
use mluc_kernels::{Element, Epilogue, Gather, Weights, convolve};
use mluc_model::Folded;

/// Packed weights and bias of a layer that reads rows of `V`.
#[derive(Clone, Debug)]
pub(crate) struct Convolution<V: Value> {
    weights: Weights<V>,
    bias: Vec<f32>,
}

impl<V: Value> Convolution<V> {
    /// All taps of a layer, in the scale of the rows that it reads and writes.
    pub(crate) fn new(layer: &Folded) -> Convolution<V> {
        Convolution {
            weights: Weights::pack(layer.taps, layer.cin, layer.cout, &layer.weights),
            bias: layer.bias.clone(),
        }
    }

    /// [`Convolution::new`] with a bias that corrects the rounding errors of an input of `empty_response` rows (in the scale of
    /// the rows that it reads), so that its sums for this input equal the sums of exact numbers.
    ///
    /// Almost all cells of a map have the response to an empty scene, the same row in every cell. Its rounding errors do not
    /// cancel as random errors do: they add up from tap to tap and from layer to layer.
    pub(crate) fn around(layer: &Folded, empty_response: &[f32]) -> Convolution<V> {
        let mut convolution = Convolution::new(layer);
        if !V::ROUNDS {
            return convolution;
        }
        let rounded: Vec<V> = empty_response.iter().map(|value| V::from_f32(*value)).collect();
        let gather = Gather::new(layer.taps, vec![0; layer.taps]);
        let mut found = vec![0.0; layer.cout];
        let (weights, epilogue) = (&convolution.weights, Epilogue::default());
        convolve(&rounded, &gather, weights, epilogue, None, &mut found);
        let expected = sums(layer, empty_response);
        let pairs = convolution.bias.iter_mut().zip(expected.iter().zip(found));
        pairs.for_each(|(bias, (expected, found))| *bias += expected - found);
        convolution
    }

    /// [`Convolution::around`] with one convolution per tap, for a transposed layer, whose taps write different outputs.
    pub(crate) fn by_tap(layer: &Folded, empty_response: &[f32]) -> Vec<Convolution<V>> {
        let taps = layer.weights.chunks_exact(layer.cin * layer.cout);
        taps.map(|tap| {
            let layer =
                Folded { taps: 1, weights: tap.to_vec(), bias: layer.bias.clone(), ..*layer };
            Convolution::around(&layer, empty_response)
        })
        .collect()
    }

    /// Channels of an output row.
    pub(crate) fn cout(&self) -> usize {
        self.bias.len()
    }

    /// Computes output rows from input rows; `output_rows` names the place of each (`None`: in order).
    pub(crate) fn run<O: Element>(
        &self,
        input: &[V],
        gather: &Gather,
        output_rows: Option<&[u32]>,
        output: &mut [O],
    ) {
        let (weights, epilogue) = (&self.weights, self.epilogue());
        convolve(input, gather, weights, epilogue, output_rows, output);
    }

    pub(crate) fn epilogue(&self) -> Epilogue<'_> {
        Epilogue { bias: Some(&self.bias), relu: true }
    }
}

/// The output of a layer before the bias, if every tap reads the same row.
fn sums(layer: &Folded, row: &[f32]) -> Vec<f32> {
    let mut sums = vec![0.0; layer.cout];
    let weights = layer.weights.chunks_exact(layer.cout.max(1));
    for (weights, value) in weights.zip(row.iter().cycle()) {
        sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += weight * value);
    }
    sums
}

/// The output of a layer with its bias and ReLU, if every tap reads the same row.
pub(crate) fn response(layer: &Folded, row: &[f32]) -> Vec<f32> {
    sums(layer, row).into_iter().zip(&layer.bias).map(|(sum, bias)| (sum + bias).max(0.0)).collect()
}
