//! The training step: forward, losses, backward, optimiser.

use crate::network::{Chain, Pass, StepInput};
use crate::{
    error::{TrainError, diverged},
    layers::RunningStatistics,
    loader::Batch,
    log::Progress,
    pool::Pool,
};
use crate::{losses, losses::LossSettings, optimizer::Adam, optimizer::Schedule};
use mluc_model::Network;

/// Minimum share of a new batch in the running statistics. At first the plain mean of all batches applies, so that a short run does not keep the
/// statistics of its first weights. At the end of the cycle the rate is nearly 0, so the last 50 batches have almost equal weights and set the statistics.
const MOMENTUM_MIN: f32 = 0.02;

/// State of the training.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainState {
    /// Weights.
    pub parameters: Vec<f32>,
    /// Batch norm's statistics for inference.
    pub running: RunningStatistics,
    /// Optimiser.
    pub adam: Adam,
    /// Steps done.
    pub step: u64,
}

/// A network in training.
pub struct Trainer {
    /// Layers.
    pub chain: Chain,
    /// State of the training.
    pub state: TrainState,
    schedule: Schedule,
    losses: LossSettings,
    pool: Pool,
}

impl Trainer {
    /// A trainer before the first step.
    pub fn new(network: &Network, schedule: Schedule, losses: LossSettings, seed: u64) -> Trainer {
        let chain = Chain::new(network);
        let state = TrainState {
            parameters: chain.initial(seed, losses.prototype_scale),
            running: chain.initial_running(),
            adam: Adam::new(chain.parameters),
            step: 0,
        };
        Trainer { pool: Pool::new(chain.parameters), chain, state, schedule, losses }
    }

    /// One step.
    pub fn step(&mut self, batch: &Batch) -> Result<Progress, TrainError> {
        let (plan, targets, pool) = (&batch.plan, &batch.targets, &mut self.pool);
        let chain = &self.chain;
        let input = StepInput::new(&self.state.parameters, plan, &targets.labelled);
        let pass = chain.forward(&input, pool);
        let (map, classes) = (&plan.map, chain.network.classes);
        let (losses, outputs) = losses::evaluate(&pass.outputs, map, targets, self.losses, classes);
        let loss = losses.total();
        if !loss.is_finite() {
            return Err(diverged(self.state.step, loss));
        }
        pool.gradients.fill(0.0);
        chain.backward(&input, &pass, &outputs, pool);
        follow_statistics(&mut self.state, &pass);
        pass.recycle(pool);
        let (rate, momentum) = self.schedule.at(self.state.step);
        let parameters = &mut self.state.parameters;
        let adam = &mut self.state.adam;
        let gradient_norm = adam.step(parameters, &pool.gradients, (rate, momentum));
        self.state.step += 1;
        Ok(Progress {
            step: self.state.step,
            loss,
            losses,
            gradient_norm,
            rate,
            ..Progress::default()
        })
    }
}

fn follow_statistics(state: &mut TrainState, pass: &Pass) {
    let share = MOMENTUM_MIN.max(1.0 / (state.step + 1) as f32);
    // A batch without a row gives no statistics (a scan without a point in range).
    let pairs = state.running.iter_mut().zip(pass.statistics());
    for (running, batch) in pairs.filter(|(_, batch)| batch.count >= 2.0) {
        let unbiased = (batch.count / (batch.count - 1.0)) as f32;
        let mix = |to: &mut [f32], from: &[f32], scale: f32| {
            to.iter_mut().zip(from).for_each(|(to, from)| *to += share * (from * scale - *to));
        };
        mix(&mut running.mean, &batch.mean, 1.0);
        mix(&mut running.var, &batch.var, unbiased);
    }
}
