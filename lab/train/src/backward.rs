//! The backward pass of the network: [`crate::network`] in reverse, written by hand.
//!
//! The background row of a map is read by many rows of the next one, so its gradient is computed separately (see
//! [`crate::layers::LayerPlan`]); every other row's tap has at most one reader.

use crate::layers::{add, backward_all, linear_backward};
use crate::network::{Chain, Outputs, Pass, StepInput, last};
use crate::pool::Pool;

impl Chain {
    /// Adds the gradients of every parameter to those of `pool`.
    pub fn backward(&self, input: &StepInput, pass: &Pass, outputs: &Outputs, pool: &mut Pool) {
        let [up1, up2] = self.backward_heads(input, pass, outputs, pool);
        let (p, map) = (input.parameters, &input.plan.map);
        let (middle, half) = (last(&pass.block1), last(&pass.block2));
        let plan = &map.ups[1];
        let gradient = self.up2.backward(p, half, &pass.up2, plan, up2, pool);
        let (done, plans) = (&pass.block2, &map.block2);
        let from_block2 = backward_all(&self.block2, p, middle, done, plans, gradient, pool);
        let plan = &map.ups[0];
        let mut gradient = self.up1.backward(p, middle, &pass.up1, plan, up1, pool);
        add(&mut gradient, &from_block2);
        pool.give(from_block2);
        let (done, plans) = (&pass.block1, &map.block1);
        let map = backward_all(&self.block1, p, &pass.map, done, plans, gradient, pool);
        self.backward_sparse(input, pass, &map, pool);
        pool.give(map);
    }

    /// Gradients of the rows of up 1 and up 2.
    fn backward_heads(
        &self,
        input: &StepInput,
        pass: &Pass,
        outputs: &Outputs,
        pool: &mut Pool,
    ) -> [Vec<f32>; 2] {
        let (parameters, labelled) = (input.parameters, input.labelled);
        let head = &self.heads.presence;
        for row in outputs.presence[0].chunks_exact(head.cout) {
            add(&mut pool.gradients[head.bias.clone()], row);
        }
        let widths = [self.up1.channels, self.up2.channels];
        let halves = self.presence_halves();
        let mut back = [&pass.up1.y, &pass.up2.y].map(|y| pool.take(y.len()));
        for (number, y) in [&pass.up1.y, &pass.up2.y].into_iter().enumerate() {
            let (shape, half) = ([widths[number], head.cout], halves[number].clone());
            let (d, plain) = (&outputs.presence[number], &parameters[half.clone()]);
            let to = &mut pool.gradients[half];
            linear_backward(y, shape, plain, d, to, &mut back[number]);
        }
        let features = &pass.labelled_features;
        let mut d = vec![0.0; features.len()];
        for (head, output) in self.heads.of_labelled().zip(outputs.of_labelled()) {
            let gradients = &mut pool.gradients;
            head.backward(parameters, gradients, features, output, &mut d);
        }
        for (&cell, d) in labelled.iter().zip(d.chunks_exact(widths[0] + widths[1])) {
            let [row1, row2] = input.plan.map.up_rows(cell as usize);
            let (d1, d2) = d.split_at(widths[0]);
            add(&mut back[0][row1 * widths[0]..][..widths[0]], d1);
            add(&mut back[1][row2 * widths[1]..][..widths[1]], d2);
        }
        back
    }

    /// The second part of [`Chain::backward`]: sparse layers, from the gradient of the map's rows.
    fn backward_sparse(&self, input: &StepInput, pass: &Pass, map: &[f32], pool: &mut Pool) {
        let plan = input.plan;
        let Some(output) = self.sparse.last() else {
            return;
        };
        let (width, channels) = (self.network.map_channels(), output.channels);
        let depth = width / channels;
        let scatter = &plan.map.scatter;
        let mut gradient = pool.take(scatter.len() * channels);
        for ((row, z), to) in scatter.iter().zip(gradient.chunks_exact_mut(channels)) {
            let cell = &map[*row as usize * width..][..width];
            let level = cell[*z as usize..].iter().step_by(depth);
            to.iter_mut().zip(level).for_each(|(to, from)| *to = *from);
        }
        let (p, layers) = (input.parameters, &self.sparse);
        let (voxels, plans) = (&plan.voxels, &plan.sparse);
        backward_all(layers, p, voxels, &pass.sparse, plans, gradient, pool);
    }
}
