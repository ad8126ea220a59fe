//! One step after another: forward, losses, backward, optimiser.

use std::time::Instant;

use mluc_model::Network;

use super::error::TrainError;
use super::layers::Pool;
use super::loader::Batch;
use super::losses::{self, Losses, MetricSettings};
use super::network::{Chain, Running};
use super::optimizer::{Adam, Schedule};

/// The share of a new batch in the running statistics, once enough batches have been seen. Before, the plain mean of all
/// batches: a short run must not remember its first weights. At the end of the cycle the rate is nearly 0, so the last
/// 50 batches share one set of weights and the statistics are theirs.
const MOMENTUM_MIN: f32 = 0.02;

/// What training has reached.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// Weights.
    pub parameters: Vec<f32>,
    /// Batch norm's statistics for inference.
    pub running: Running,
    /// Optimiser.
    pub adam: Adam,
    /// Steps done.
    pub step: u64,
}

/// Where a step's time went, ms.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub struct Timing {
    /// Waiting for the batch.
    pub wait: f64,
    /// Preparing it, on the other thread.
    pub prepare: f64,
    /// Forward.
    pub forward: f64,
    /// Losses.
    pub losses: f64,
    /// Backward.
    pub backward: f64,
    /// Optimiser.
    pub update: f64,
}

/// What a step says.
#[derive(Clone, Copy, Debug, Default)]
pub struct Report {
    /// Losses.
    pub losses: Losses,
    /// Norm of the gradient before clipping.
    pub gradient_norm: f64,
    /// Learning rate.
    pub rate: f64,
    /// Times.
    pub timing: Timing,
}

/// A network in training.
pub struct Trainer {
    /// Layers.
    pub chain: Chain,
    /// What training has reached.
    pub state: State,
    schedule: Schedule,
    metric: MetricSettings,
    gradients: Vec<f32>,
    pool: Pool,
}

impl Trainer {
    /// Before the first step.
    pub fn new(
        network: &Network,
        schedule: Schedule,
        metric: MetricSettings,
        seed: u64,
    ) -> Trainer {
        let chain = Chain::new(network);
        let state = State {
            parameters: chain.initial(seed, metric.prototype_scale),
            running: chain.initial_running(),
            adam: Adam::new(chain.parameters),
            step: 0,
        };
        let gradients = vec![0.0; chain.parameters];
        Trainer {
            chain,
            state,
            schedule,
            metric,
            gradients,
            pool: Pool::default(),
        }
    }

    /// One step.
    pub fn step(&mut self, batch: &Batch) -> Result<Report, TrainError> {
        let (plan, targets) = (&batch.plan, &batch.targets);
        let mut timing = Timing {
            prepare: 1e3 * batch.seconds,
            ..Timing::default()
        };
        let mut clock = Instant::now();
        let mut lap = || {
            let ms = 1e3 * clock.elapsed().as_secs_f64();
            clock = Instant::now();
            ms
        };
        let parameters = &self.state.parameters;
        let pass = self
            .chain
            .forward(parameters, plan, &targets.labelled, None, &mut self.pool);
        timing.forward = lap();
        let classes = self.chain.network.classes;
        let (losses, outputs) = losses::evaluate(&pass, &plan.map, targets, self.metric, classes);
        timing.losses = lap();
        if !losses.total().is_finite() {
            return Err(TrainError::Diverged {
                step: self.state.step,
                found: losses.total(),
            });
        }
        self.gradients.fill(0.0);
        let (labelled, gradients) = (&targets.labelled, &mut self.gradients);
        self.chain.backward(
            parameters,
            plan,
            labelled,
            &pass,
            &outputs,
            gradients,
            &mut self.pool,
        );
        timing.backward = lap();
        self.follow_statistics(&pass);
        pass.recycle(&mut self.pool);
        let at = self.schedule.at(self.state.step);
        let gradient_norm = self
            .state
            .adam
            .step(&mut self.state.parameters, &self.gradients, at);
        self.state.step += 1;
        timing.update = lap();
        Ok(Report {
            losses,
            gradient_norm,
            rate: at.0,
            timing,
        })
    }

    fn follow_statistics(&mut self, pass: &super::network::Pass) {
        let share = MOMENTUM_MIN.max(1.0 / (self.state.step + 1) as f32);
        for (running, batch) in self
            .state
            .running
            .iter_mut()
            .zip(self.chain.statistics(pass))
        {
            // A batch without a row says nothing (a scan without a point in range).
            if batch.count < 2.0 {
                continue;
            }
            let unbiased = (batch.count / (batch.count - 1.0)) as f32;
            let mix = |to: &mut f32, from: f32| *to += share * (from - *to);
            running
                .mean
                .iter_mut()
                .zip(&batch.mean)
                .for_each(|(r, b)| mix(r, *b));
            running
                .variance
                .iter_mut()
                .zip(&batch.variance)
                .for_each(|(r, b)| mix(r, *b * unbiased));
        }
    }

    /// The scratch memory, for evaluation between steps.
    pub fn pool(&mut self) -> &mut Pool {
        &mut self.pool
    }
}
