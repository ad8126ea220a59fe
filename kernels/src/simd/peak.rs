//! A loop of multiply-adds that uses only registers: the peak of the processor.

use super::{Kernel, Level, Simd, load, store};
use crate::Element;
use std::{hint::black_box, marker::PhantomData};

/// Independent sums: more than the latency of a multiply-add times the number of units that do it.
const SUMS: usize = 12;

/// Multiplies and adds values of `I` in registers, `steps` times. Returns the number of operations; the caller measures the time.
pub fn spin<I: Element>(level: Level, steps: usize) -> f64 {
    level.run(Spin { steps, of: PhantomData::<I> })
}

struct Spin<I> {
    steps: usize,
    of: PhantomData<I>,
}

impl<I: Element> Kernel for Spin<I> {
    type Output = f64;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> f64 {
        let weights = [I::pack(0, I::STEP, 1.0, |_| 1.0); 16];
        let mut values = [I::Sum::default(); 16];
        // SAFETY: a register has at most 16 lanes; `weights` and `values` have 16 values, an input has the 4 of the longest step.
        unsafe {
            let mut sums: [I::Total<S>; SUMS] = [load(values.as_ptr()); SUMS];
            // The compiler would compute equal products once. So the weights are read anew in each step, and where product and
            // sum are two instructions, each sum has its own input.
            let mut inputs = [I::splat(simd, [I::from_f32(1.0); 4].as_ptr()); SUMS];
            for number in (0..SUMS).filter(|_| I::STEP > 1) {
                let input = black_box([I::from_f32(number as f32); 4]);
                inputs[number] = I::splat(simd, input.as_ptr());
            }
            for _ in 0..self.steps {
                let weights = load(black_box(weights.as_ptr()));
                for k in 0..SUMS {
                    sums[k] = I::multiply(simd, inputs[k], weights, sums[k]);
                }
            }
            for sum in sums {
                store(black_box(values.as_mut_ptr()), sum);
            }
        }
        black_box(&mut values);
        (self.steps * SUMS * S::LANES * 2 * I::STEP) as f64
    }
}
