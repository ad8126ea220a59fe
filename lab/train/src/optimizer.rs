//! Adam with decoupled weight decay under a one-cycle schedule (the public SECOND configuration).

const BETA2: f64 = 0.99;
const EPSILON: f64 = 1e-8;
const WEIGHT_DECAY: f64 = 0.01;
const GRADIENT_NORM_MAX: f64 = 10.0;
/// Share of the steps in which the rate increases.
const RISE: f64 = 0.4;
/// The initial rate is the highest rate divided by this.
const START_DIVISOR: f64 = 10.0;
/// The final rate is the initial rate divided by this.
const END_DIVISOR: f64 = 1e4;
const MOMENTA: [f64; 2] = [0.95, 0.85];

/// The one-cycle schedule: cosine from a tenth of the highest rate up to it and down to nearly 0; the momentum changes in the opposite direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Schedule {
    /// Highest learning rate.
    pub rate_max: f64,
    /// Total number of steps.
    pub steps: u64,
}

impl Schedule {
    /// The schedule of a run of `steps`.
    pub fn new(rate_max: f64, steps: u64) -> Schedule {
        Schedule { rate_max, steps }
    }

    /// Learning rate and momentum (Adam's first beta) of a step.
    pub fn at(&self, step: u64) -> (f64, f64) {
        let rise = (RISE * self.steps as f64).max(1.0);
        let cosine = |from: f64, to: f64, share: f64| {
            to + (from - to) / 2.0 * (1.0 + (std::f64::consts::PI * share.clamp(0.0, 1.0)).cos())
        };
        let (step, low) = (step as f64, self.rate_max / START_DIVISOR);
        if step < rise {
            let share = step / rise;
            let rate = cosine(low, self.rate_max, share);
            (rate, cosine(MOMENTA[0], MOMENTA[1], share))
        } else {
            let share = (step - rise) / (self.steps as f64 - rise).max(1.0);
            let rate = cosine(self.rate_max, low / END_DIVISOR, share);
            (rate, cosine(MOMENTA[1], MOMENTA[0], share))
        }
    }
}

/// The optimiser's state.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Adam {
    /// First moments.
    pub first: Vec<f32>,
    /// Second moments.
    pub second: Vec<f32>,
    /// Product of the momenta so far: with a changing momentum the bias of the first moment is 1 minus this product.
    pub momentum_product: f64,
    /// Number of steps taken.
    pub steps: u64,
}

impl Adam {
    /// The initial state for `count` parameters.
    pub fn new(count: usize) -> Adam {
        Adam { first: vec![0.0; count], second: vec![0.0; count], momentum_product: 1.0, steps: 0 }
    }

    /// One step; returns the gradient's norm before clipping. A non-finite gradient changes nothing.
    pub fn step(
        &mut self,
        parameters: &mut [f32],
        gradients: &[f32],
        (rate, momentum): (f64, f64),
    ) -> f64 {
        let norm = gradients.iter().map(|g| f64::from(*g).powi(2)).sum::<f64>().sqrt();
        if !norm.is_finite() {
            return norm;
        }
        let clip = (GRADIENT_NORM_MAX / (norm + 1e-6)).min(1.0) as f32;
        self.steps += 1;
        self.momentum_product *= momentum;
        let first_scale = (1.0 / (1.0 - self.momentum_product)) as f32;
        let second_scale = (1.0 / (1.0 - BETA2.powi(self.steps.min(100_000) as i32))) as f32;
        let (keep, momentum) = ((1.0 - rate * WEIGHT_DECAY) as f32, momentum as f32);
        let moments = self.first.iter_mut().zip(&mut self.second);
        for ((p, g), (m, v)) in parameters.iter_mut().zip(gradients).zip(moments) {
            let g = g * clip;
            *m = momentum * *m + (1.0 - momentum) * g;
            *v = BETA2 as f32 * *v + (1.0 - BETA2 as f32) * g * g;
            let change = *m * first_scale / ((*v * second_scale).sqrt() + EPSILON as f32);
            *p = *p * keep - rate as f32 * change;
        }
        norm
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_schedule_meets_its_corners() {
        let schedule = Schedule::new(3e-3, 1000);
        let near = |a: f64, b: f64| (a - b).abs() < 1e-9;
        let corners = [(0, 3e-4, 0.95), (400, 3e-3, 0.85), (1000, 3e-8, 0.95)];
        for (step, rate, momentum) in corners {
            let (r, m) = schedule.at(step);
            assert!(near(r, rate) && near(m, momentum), "{step}: {r} {m}");
        }
        assert!((1..400).all(|s| schedule.at(s).0 > schedule.at(s - 1).0));
    }

    #[test]
    fn a_gradient_that_is_no_number_changes_nothing() {
        let mut x = [3.0f32, -2.0];
        let mut adam = Adam::new(2);
        adam.step(&mut x, &[5.0, -45.0], (0.01, 0.9));
        let before = (x, adam.clone());
        assert!(adam.step(&mut x, &[f32::NAN, 0.0], (0.01, 0.9)).is_nan());
        assert_eq!((x, adam), before);
    }
}
