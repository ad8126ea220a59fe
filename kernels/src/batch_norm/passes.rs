//! The passes over the rows of a batch. The compiler vectorises them for the level that runs them.

use crate::simd::{Kernel, Simd, clamp};

/// Sum of x and of its square for each channel.
pub(super) struct Moments<'a> {
    pub(super) x: &'a [f32],
    pub(super) channels: usize,
}

impl Kernel for Moments<'_> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> Vec<f64> {
        let mut sums = vec![0.0; 2 * self.channels];
        let (sum, square) = sums.split_at_mut(self.channels);
        for row in self.x.chunks_exact(self.channels) {
            for ((sum, square), &x) in sum.iter_mut().zip(&mut *square).zip(row) {
                let x = f64::from(x);
                *sum += x;
                *square += x * x;
            }
        }
        sums
    }
}

/// Sum of dy and of dy * (x - mean) for each channel; dy is zero where the ReLU was closed.
pub(super) struct Products<'a> {
    pub(super) x: &'a [f32],
    pub(super) y: &'a [f32],
    pub(super) dy: &'a [f32],
    pub(super) mean: &'a [f32],
    pub(super) relu: bool,
}

impl Kernel for Products<'_> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> Vec<f64> {
        let channels = self.mean.len();
        let mut sums = vec![0.0; 2 * channels];
        let (sum, product) = sums.split_at_mut(channels);
        let (x, y) = (self.x.chunks_exact(channels), self.y.chunks_exact(channels));
        let rows = x.zip(y);
        for ((x, y), dy) in rows.zip(self.dy.chunks_exact(channels)) {
            let values = x.iter().zip(y).zip(dy).zip(self.mean);
            let sums = sum.iter_mut().zip(&mut *product);
            for ((((&x, &y), &dy), &mean), (sum, product)) in values.zip(sums) {
                let dy = if y > 0.0 || !self.relu { dy } else { 0.0 };
                *sum += f64::from(dy);
                *product += f64::from(dy * (x - mean));
            }
        }
        sums
    }
}

pub(super) struct Normalise<'a> {
    pub(super) x: &'a [f32],
    pub(super) y: &'a mut [f32],
    pub(super) mean: &'a [f32],
    pub(super) scale: &'a [f32],
    pub(super) beta: &'a [f32],
    pub(super) relu: bool,
}

impl Kernel for Normalise<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let channels = self.mean.len();
        let floor = if self.relu { 0.0 } else { f32::NEG_INFINITY };
        let rows = self.y.chunks_exact_mut(channels);
        for (y, x) in rows.zip(self.x.chunks_exact(channels)) {
            let affine = self.scale.iter().zip(self.beta);
            let values = x.iter().zip(self.mean).zip(affine);
            for (y, ((&x, &mean), (&scale, &beta))) in y.iter_mut().zip(values) {
                let value = (x - mean) * scale + beta;
                *y = clamp(value, floor);
            }
        }
    }
}

/// The gradient of x is `gain * dy - multiplicity * (mean + (x - mean of x) * slant)`.
pub(super) struct Slope {
    pub(super) gain: Vec<f32>,
    pub(super) mean: Vec<f32>,
    pub(super) slant: Vec<f32>,
}

pub(super) struct Differentiate<'a> {
    pub(super) x: &'a [f32],
    pub(super) y: &'a [f32],
    pub(super) dy: &'a mut [f32],
    pub(super) mean: &'a [f32],
    pub(super) slope: &'a Slope,
    pub(super) multiplicity: f32,
    pub(super) relu: bool,
}

impl Kernel for Differentiate<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let channels = self.mean.len();
        let (x, y) = (self.x.chunks_exact(channels), self.y.chunks_exact(channels));
        let rows = x.zip(y);
        for (dy, (x, y)) in self.dy.chunks_exact_mut(channels).zip(rows) {
            let values = x.iter().zip(y).zip(self.mean);
            let Slope { gain, mean, slant } = self.slope;
            let values = values.zip(gain.iter().zip(mean).zip(slant));
            for (dy, (((&x, &y), &mean), ((&gain, &offset), &slant))) in dy.iter_mut().zip(values) {
                let open = if y > 0.0 || !self.relu { *dy } else { 0.0 };
                *dy = gain * open - self.multiplicity * (offset + (x - mean) * slant);
            }
        }
    }
}
