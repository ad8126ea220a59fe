//! One convolution with batch norm and ReLU, and a head: forward and backward passes on rows.

use crate::norm::{self, Activation, Statistics, Tail};
use crate::pool::{Pool, round};
use mluc_kernels::{Element, Epilogue, Gather, Level, Trainable, Weights};
use mluc_kernels::{convolve, weight_gradient};
use std::ops::Range;

/// The rows that a layer reads and writes in one batch.
#[derive(Clone, Debug, Default)]
pub struct LayerPlan {
    /// For each output row the input rows that it reads.
    pub gather: Gather,
    /// For each input row (without the background) the output rows that read it, for the input's gradient; `None` where that is not needed.
    pub transposed: Option<Gather>,
    /// The last input row, where it represents many cells and so has many readers.
    pub background: Option<u32>,
    /// The last output rows, which represent many cells.
    pub tail: Tail,
}

/// A layer and the positions of its numbers in the flat parameter list.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// Name, such as `backbone2d.block1.0`.
    pub name: String,
    /// Number of kernel taps in the gather.
    pub taps: usize,
    /// Input channels.
    pub cin: usize,
    /// Columns of the weights: `channels`, or 4 * `channels` for the 2x2 transposed convolution.
    pub cout: usize,
    /// Number of batch norm channels.
    pub channels: usize,
    /// Range of the weights, `[tap][cin][cout]`.
    pub weight: Range<usize>,
    /// Batch norm's scale.
    pub gamma: Range<usize>,
    /// Batch norm's shift; follows `gamma`.
    pub beta: Range<usize>,
    /// Index of this layer's running statistics.
    pub norm: usize,
    /// Multiply in bf16, forward and backward; sums and everything else stay f32.
    pub bf16: bool,
}

/// Running statistics, by [`Layer::norm`].
pub type RunningStatistics = Vec<Statistics>;

impl Layer {
    /// Uses batch statistics when `running` is `None`, else the given ones.
    pub fn forward(
        &self,
        parameters: &[f32],
        input: &[f32],
        plan: &LayerPlan,
        running: Option<&RunningStatistics>,
        pool: &mut Pool,
    ) -> Activation {
        let plain = &parameters[self.weight.clone()];
        let mut x = pool.take(plan.gather.outputs() * self.cout);
        if self.bf16 {
            let input = round(input, &mut pool.rounded[0]);
            self.convolve(input, &plan.gather, plain, &mut x);
        } else {
            self.convolve(input, &plan.gather, plain, &mut x);
        }
        let mut y = pool.take(x.len());
        let affine = [&self.gamma, &self.beta].map(|range| &parameters[range.clone()]);
        let statistics = if let Some(running) = running {
            let statistics = running[self.norm].clone();
            norm::normalise(&x, affine, &statistics, &mut y);
            statistics
        } else {
            norm::forward(&x, affine, plan.tail, &mut y)
        };
        Activation { x, y, statistics }
    }

    /// Adds to the parameters' gradients. `gradient` is that of the activation's `y`; returns the gradient of `input`, empty without one in the plan.
    pub fn backward(
        &self,
        parameters: &[f32],
        input: &[f32],
        activation: &Activation,
        plan: &LayerPlan,
        mut gradient: Vec<f32>,
        pool: &mut Pool,
    ) -> Vec<f32> {
        let mut all = vec![];
        if plan.transposed.is_some() {
            all = pool.take(input.len());
        }
        let affine = &mut pool.gradients[self.gamma.start..self.beta.end];
        let affine = affine.split_at_mut(self.channels);
        let gamma = &parameters[self.gamma.clone()];
        norm::backward(activation, plan.tail, gamma, &mut gradient, affine);
        let plain = &parameters[self.weight.clone()];
        let weight = &mut pool.gradients[self.weight.clone()];
        let shape = [self.taps, self.cin, self.cout];
        let gathers = (&plan.gather, plan.transposed.as_ref());
        if self.bf16 {
            let [x, dy] = &mut pool.rounded;
            let rows = [round(input, x), round(&gradient, dy)];
            gradients(rows, gathers, shape, plain, weight, &mut all);
        } else {
            let rows = [input, &gradient];
            gradients(rows, gathers, shape, plain, weight, &mut all);
        }
        if let (Some(transposed), Some(background)) = (&plan.transposed, plan.background) {
            let last = &mut all[transposed.outputs() * self.cin..];
            self.background_gradient(plain, &gradient, &plan.gather, background, last);
        }
        pool.give(gradient);
        all
    }

    fn convolve<I: Element>(&self, input: &[I], gather: &Gather, plain: &[f32], to: &mut [f32]) {
        let weights = Weights::pack(self.taps, self.cin, self.cout, plain);
        convolve(input, gather, &weights, Epilogue::default(), None, to);
    }

    /// Gradient of the background row: for each tap, the sum of its readers' gradients times the weights of that tap.
    fn background_gradient(
        &self,
        weights: &[f32],
        gradient: &[f32],
        gather: &Gather,
        background: u32,
        to: &mut [f32],
    ) {
        let mut sums = vec![0.0f32; self.taps * self.cout];
        let rows = gradient.chunks_exact(self.cout);
        for (taps, row) in gather.index.chunks_exact(self.taps).zip(rows) {
            for (sum, input) in sums.chunks_exact_mut(self.cout).zip(taps) {
                if *input == background {
                    add(sum, row);
                }
            }
        }
        let weights = weights.chunks_exact(self.cin * self.cout);
        to.fill(0.0);
        for (sum, weights) in sums.chunks_exact(self.cout).zip(weights) {
            for (to, row) in to.iter_mut().zip(weights.chunks_exact(self.cout)) {
                *to += row.iter().zip(sum).map(|(w, s)| w * s).sum::<f32>();
            }
        }
    }
}

/// Runs layers one after another.
pub(crate) fn forward_all(
    layers: &[Layer],
    parameters: &[f32],
    input: &[f32],
    plans: &[LayerPlan],
    running: Option<&RunningStatistics>,
    pool: &mut Pool,
) -> Vec<Activation> {
    let mut activations: Vec<Activation> = vec![];
    for (layer, plan) in layers.iter().zip(plans) {
        let input = activations.last().map_or(input, |a| &a.y);
        activations.push(layer.forward(parameters, input, plan, running, pool));
    }
    activations
}

/// The gradient of the first layer's input, from the gradient of the last layer's output.
pub(crate) fn backward_all(
    layers: &[Layer],
    parameters: &[f32],
    input: &[f32],
    activations: &[Activation],
    plans: &[LayerPlan],
    mut gradient: Vec<f32>,
    pool: &mut Pool,
) -> Vec<f32> {
    for (i, (layer, plan)) in layers.iter().zip(plans).enumerate().rev() {
        let input = i.checked_sub(1).map_or(input, |i| &activations[i].y);
        let own = &activations[i];
        gradient = layer.backward(parameters, input, own, plan, gradient, pool);
    }
    gradient
}

pub(crate) fn add(to: &mut [f32], from: &[f32]) {
    to.iter_mut().zip(from).for_each(|(t, f)| *t += f);
}

/// A gather of `rows` rows onto themselves.
pub(crate) fn identity(rows: usize) -> Gather {
    let index = (0..rows as u32).collect();
    Gather { taps: 1, index }
}

/// A 1x1 convolution with a bias: a head.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Linear {
    /// Name, such as `head.box`.
    pub name: String,
    /// Input channels.
    pub cin: usize,
    /// Output channels.
    pub cout: usize,
    /// Range of the weights, `[cin][cout]`.
    pub weight: Range<usize>,
    /// Range of the bias, `cout` values.
    pub bias: Range<usize>,
}

impl Linear {
    /// Gives `cout` outputs per row.
    pub fn forward(&self, parameters: &[f32], input: &[f32]) -> Vec<f32> {
        let plain = &parameters[self.weight.clone()];
        let bias = Some(&parameters[self.bias.clone()]);
        linear(input, [self.cin, self.cout], plain, bias)
    }

    /// Adds to the gradients of the parameters and of the input.
    pub fn backward(
        &self,
        parameters: &[f32],
        gradients: &mut [f32],
        input: &[f32],
        gradient: &[f32],
        input_gradient: &mut [f32],
    ) {
        for row in gradient.chunks_exact(self.cout) {
            add(&mut gradients[self.bias.clone()], row);
        }
        let plain = &parameters[self.weight.clone()];
        let to = &mut gradients[self.weight.clone()];
        let mut back = vec![0.0; input.len()];
        linear_backward(input, [self.cin, self.cout], plain, gradient, to, &mut back);
        add(input_gradient, &back);
    }
}

/// Rows times weights `[cin][cout]`, plus a bias.
pub(crate) fn linear(
    input: &[f32],
    [cin, cout]: [usize; 2],
    plain: &[f32],
    bias: Option<&[f32]>,
) -> Vec<f32> {
    let rows = identity(input.len() / cin);
    let weights = Weights::pack(1, cin, cout, plain);
    let mut output = vec![0.0; rows.outputs() * cout];
    let epilogue = Epilogue { bias, relu: false };
    convolve(input, &rows, &weights, epilogue, None, &mut output);
    output
}

/// From the gradient of [`linear`]'s output: adds the weights' gradient to `to`, and writes the input's gradient to `back`.
pub(crate) fn linear_backward(
    input: &[f32],
    [cin, cout]: [usize; 2],
    plain: &[f32],
    gradient: &[f32],
    to: &mut [f32],
    back: &mut [f32],
) {
    let rows = identity(input.len() / cin);
    let gathers = (&rows, Some(&rows));
    gradients([input, gradient], gathers, [1, cin, cout], plain, to, back);
}

/// From a convolution's output gradient: adds the gradient of the weights `[tap][cin][cout]`, and writes the input's gradient where it is needed.
fn gradients<I: Trainable>(
    [input, gradient]: [&[I]; 2],
    (gather, transposed): (&Gather, Option<&Gather>),
    [taps, cin, cout]: [usize; 3],
    plain: &[f32],
    weight: &mut [f32],
    back: &mut [f32],
) {
    let level = Level::best();
    weight_gradient(level, input, cin, gather, gradient, cout, weight);
    if let Some(transposed) = transposed {
        let weights = Weights::pack_transposed(taps, cin, cout, plain);
        let epilogue = Epilogue::default();
        convolve(gradient, transposed, &weights, epilogue, None, back);
    }
}
