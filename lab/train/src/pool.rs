//! Memory reused from step to step: a fresh large allocation costs a page fault every 4 KiB.

use mluc_kernels::{Bf16, Element, at_best};
use rayon::prelude::*;

/// Number of values in a task that rounds to bf16.
const ROUND_CHUNK: usize = 1 << 14;
/// Maximum number of vectors kept, to limit memory.
const FREE_MAX: usize = 96;

/// The unused vectors, and the gradients of a step.
#[derive(Debug, Default)]
pub struct Pool {
    /// Gradients of all parameters; the backward pass adds to them.
    pub gradients: Vec<f32>,
    /// bf16 factors of a layer: its input, and its output's gradient.
    pub(crate) rounded: [Vec<Bf16>; 2],
    free: Vec<Vec<f32>>,
}

impl Pool {
    /// A pool for the backward pass of this number of parameters.
    pub fn new(parameters: usize) -> Pool {
        Pool { gradients: vec![0.0; parameters], ..Pool::default() }
    }

    /// A vector of `len` numbers with arbitrary values.
    pub fn take(&mut self, len: usize) -> Vec<f32> {
        // The smallest vector that is large enough, else the largest.
        let fit = |v: &Vec<f32>| (v.capacity() < len, v.capacity().abs_diff(len));
        let best = (0..self.free.len()).min_by_key(|i| fit(&self.free[*i]));
        let mut vector = best.map_or_else(Vec::new, |i| self.free.swap_remove(i));
        if vector.capacity() < len {
            // Growing the old vector would copy values that are not needed.
            vector = Vec::with_capacity(len + len / 4);
        }
        vector.resize(len, 0.0);
        vector
    }

    /// Gives a vector back.
    pub fn give(&mut self, vector: Vec<f32>) {
        if self.free.len() < FREE_MAX && vector.capacity() > 0 {
            self.free.push(vector);
        }
    }
}

/// `values` in bf16, in memory that is reused.
pub(crate) fn round<'a>(values: &[f32], room: &'a mut Vec<Bf16>) -> &'a [Bf16] {
    if room.len() < values.len() {
        *room = vec![Bf16(0); values.len() + values.len() / 4];
    }
    let to = &mut room[..values.len()];
    let tasks = to.par_chunks_mut(ROUND_CHUNK).zip(values.par_chunks(ROUND_CHUNK));
    tasks.for_each(|(to, from)| {
        at_best(|| {
            to.iter_mut().zip(from).for_each(|(to, from)| *to = Bf16::from_f32(*from));
        });
    });
    to
}
