//! One convolution with batch norm and ReLU: forward and backward on rows.

use std::ops::Range;

use mluc_kernels::{
    Bf16, Epilogue, Gather, Weights, WeightsBf16, convolve, convolve_bf16, weight_gradient,
};
use rayon::prelude::*;

use super::norm::{self, Affine, Statistics, Tail};

/// Where a layer's numbers lie in the flat list of parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// `backbone2d.block1.0`, for instance.
    pub name: String,
    /// Taps of the kernel as the gather sees it.
    pub taps: usize,
    /// Input channels.
    pub cin: usize,
    /// Columns of the weights: `channels`, or 4 * `channels` for the 2x2 transposed convolution.
    pub cout: usize,
    /// Channels of batch norm.
    pub channels: usize,
    /// `[tap][cin][cout]`.
    pub weight: Range<usize>,
    /// Batch norm's scale.
    pub gamma: Range<usize>,
    /// Batch norm's shift.
    pub beta: Range<usize>,
    /// Which running statistics are this layer's.
    pub norm: usize,
    /// Multiply the gradient of the layer's input in bf16 (all else stays f32).
    pub bf16: bool,
}

/// What a layer leaves for its backward pass.
#[derive(Clone, Debug, Default)]
pub struct Activation {
    /// Before batch norm.
    pub x: Vec<f32>,
    /// After ReLU.
    pub y: Vec<f32>,
    /// Used by batch norm.
    pub statistics: Statistics,
}

/// Vectors reused from step to step: a fresh large allocation costs a page fault every 4 KiB.
#[derive(Debug, Default)]
pub struct Pool {
    free: Vec<Vec<f32>>,
    rounded: Vec<Bf16>,
}

/// Values of a task that rounds to bf16.
const ROUND_CHUNK: usize = 1 << 14;

impl Pool {
    /// A vector of `len` numbers of any value.
    pub fn take(&mut self, len: usize) -> Vec<f32> {
        // The smallest that is large enough, else the largest.
        let fit = |v: &Vec<f32>| (v.capacity() < len, v.capacity().abs_diff(len));
        let best = (0..self.free.len()).min_by_key(|i| fit(&self.free[*i]));
        let mut vector = best.map_or_else(Vec::new, |i| self.free.swap_remove(i));
        if vector.capacity() < len {
            // Growing would copy what nobody reads.
            vector = Vec::with_capacity(len + len / 4);
        }
        vector.resize(len, 0.0);
        vector
    }

    /// `values` in bf16, in memory that the next call takes again.
    fn round(&mut self, values: &[f32]) -> &[Bf16] {
        if self.rounded.len() < values.len() {
            self.rounded = vec![Bf16(0); values.len() + values.len() / 4];
        }
        let to = &mut self.rounded[..values.len()];
        to.par_chunks_mut(ROUND_CHUNK)
            .zip(values.par_chunks(ROUND_CHUNK))
            .for_each(|(to, from)| {
                // Nearest, ties to even, without the case of NaN: a loss that is no number ends the run anyway.
                for (to, from) in to.iter_mut().zip(from) {
                    let bits = from.to_bits();
                    *to = Bf16((bits.wrapping_add(0x7fff + ((bits >> 16) & 1)) >> 16) as u16);
                }
            });
        to
    }

    /// Gives a vector back.
    pub fn give(&mut self, vector: Vec<f32>) {
        if self.free.len() < 96 && vector.capacity() > 0 {
            self.free.push(vector);
        }
    }
}

impl Layer {
    /// Batch statistics when `running` is `None`, else those given.
    pub fn forward(
        &self,
        parameters: &[f32],
        input: &[f32],
        gather: &Gather,
        tail: Tail,
        running: Option<&Statistics>,
        pool: &mut Pool,
    ) -> Activation {
        let weights = Weights::pack(
            self.taps,
            self.cin,
            self.cout,
            &parameters[self.weight.clone()],
        );
        let mut x = pool.take(gather.outputs() * self.cout);
        convolve(input, gather, &weights, Epilogue::default(), None, &mut x);
        let mut y = pool.take(x.len());
        let affine = Affine {
            gamma: &parameters[self.gamma.clone()],
            beta: &parameters[self.beta.clone()],
        };
        let statistics = match running {
            Some(running) => {
                norm::normalise(&x, affine, running, &mut y);
                running.clone()
            }
            None => norm::forward(&x, affine, tail, &mut y),
        };
        Activation { x, y, statistics }
    }

    /// Adds to the gradients of the parameters and turns `gradient` from that of `y` into that of `x`.
    pub fn backward(
        &self,
        parameters: &[f32],
        gradients: &mut [f32],
        input: &[f32],
        activation: &Activation,
        gather: &Gather,
        tail: Tail,
        gradient: &mut [f32],
    ) {
        let Activation { x, y, statistics } = activation;
        let affine = norm::backward(
            x,
            y,
            gradient,
            &parameters[self.gamma.clone()],
            statistics,
            tail,
        );
        add(&mut gradients[self.gamma.clone()], &affine.gamma);
        add(&mut gradients[self.beta.clone()], &affine.beta);
        let weight = &mut gradients[self.weight.clone()];
        weight_gradient(input, self.cin, gather, gradient, self.cout, weight);
    }

    /// Gradient of the input rows that `transposed` lists, from that of `x`.
    pub fn input_gradient(
        &self,
        parameters: &[f32],
        gradient: &[f32],
        transposed: &Gather,
        to: &mut [f32],
        pool: &mut Pool,
    ) {
        let (taps, cin, cout) = (self.taps, self.cin, self.cout);
        let plain = &parameters[self.weight.clone()];
        if self.bf16 {
            let weights =
                WeightsBf16::pack(taps, cout, cin, &transposed_weights(taps, cin, cout, plain));
            convolve_bf16(
                pool.round(gradient),
                transposed,
                &weights,
                Epilogue::default(),
                None,
                to,
            );
        } else {
            let weights = Weights::pack_transposed(taps, cin, cout, plain);
            convolve(
                gradient,
                transposed,
                &weights,
                Epilogue::default(),
                None,
                to,
            );
        }
    }

    /// Gradient of the background row, which many outputs read: for each tap, the sum of its readers' gradients times
    /// that tap's weights.
    pub fn background_gradient(
        &self,
        parameters: &[f32],
        gradient: &[f32],
        gather: &Gather,
        background: u32,
        to: &mut [f32],
    ) {
        let mut sums = vec![0.0f32; self.taps * self.cout];
        for (taps, row) in gather
            .index
            .chunks_exact(self.taps)
            .zip(gradient.chunks_exact(self.cout))
        {
            for (sum, input) in sums.chunks_exact_mut(self.cout).zip(taps) {
                if *input == background {
                    add(sum, row);
                }
            }
        }
        let weights = parameters[self.weight.clone()].chunks_exact(self.cin * self.cout);
        to.fill(0.0);
        for (sum, weights) in sums.chunks_exact(self.cout).zip(weights) {
            for (to, row) in to.iter_mut().zip(weights.chunks_exact(self.cout)) {
                *to += row.iter().zip(sum).map(|(w, s)| w * s).sum::<f32>();
            }
        }
    }
}

/// `[tap][cin][cout]` as `[tap][cout][cin]`.
fn transposed_weights(taps: usize, cin: usize, cout: usize, plain: &[f32]) -> Vec<f32> {
    let at = |i: usize| plain[(i / (cin * cout) * cin + i % cin) * cout + i / cin % cout];
    (0..taps * cin * cout).map(at).collect()
}

/// `to += from`.
pub fn add(to: &mut [f32], from: &[f32]) {
    to.iter_mut().zip(from).for_each(|(t, f)| *t += f);
}

/// A 1x1 convolution with a bias: a head.
#[derive(Clone, Debug, PartialEq)]
pub struct Linear {
    /// `head.box`, for instance.
    pub name: String,
    /// Input channels.
    pub cin: usize,
    /// Output channels.
    pub cout: usize,
    /// `[cin][cout]`.
    pub weight: Range<usize>,
    /// `cout` values.
    pub bias: Range<usize>,
}

impl Linear {
    /// `rows * cout` outputs.
    pub fn forward(&self, parameters: &[f32], input: &[f32], rows: &Gather) -> Vec<f32> {
        let weights = Weights::pack(1, self.cin, self.cout, &parameters[self.weight.clone()]);
        let mut output = vec![0.0; rows.outputs() * self.cout];
        let bias = Epilogue {
            bias: Some(&parameters[self.bias.clone()]),
            relu: false,
        };
        convolve(input, rows, &weights, bias, None, &mut output);
        output
    }

    /// Adds to the parameters' gradients and to the input's.
    pub fn backward(
        &self,
        parameters: &[f32],
        gradients: &mut [f32],
        input: &[f32],
        rows: &Gather,
        gradient: &[f32],
        input_gradient: &mut [f32],
    ) {
        for row in gradient.chunks_exact(self.cout) {
            add(&mut gradients[self.bias.clone()], row);
        }
        weight_gradient(
            input,
            self.cin,
            rows,
            gradient,
            self.cout,
            &mut gradients[self.weight.clone()],
        );
        let plain = &parameters[self.weight.clone()];
        let weights = Weights::pack_transposed(1, self.cin, self.cout, plain);
        let mut back = vec![0.0; input.len()];
        convolve(
            gradient,
            rows,
            &weights,
            Epilogue::default(),
            None,
            &mut back,
        );
        add(input_gradient, &back);
    }
}
