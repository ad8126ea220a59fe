//! The backward pass of the network: [`super::network`] in reverse, by hand.
//!
//! The background row of a map is read by many rows of the next one, so its gradient is gathered apart (see
//! [`super::layers::Layer::background_gradient`]); every other row's tap has one reader at most.

use mluc_kernels::{Epilogue, Weights, convolve, weight_gradient};

use super::halo::Step;
use super::layers::{Activation, Layer, Pool, add};
use super::network::{Chain, OutputGradients, Pass, last, tail_of};
use super::norm::Tail;
use super::plan::{Plan, identity};

impl Chain {
    /// Adds the gradients of every parameter to `gradients`.
    pub fn backward(
        &self,
        parameters: &[f32],
        plan: &Plan,
        labelled: &[u32],
        pass: &Pass,
        outputs: &OutputGradients,
        gradients: &mut [f32],
        pool: &mut Pool,
    ) {
        let map = self.backward_map(parameters, plan, labelled, pass, outputs, gradients, pool);
        self.backward_sparse(parameters, plan, pass, &map, gradients, pool);
        pool.give(map);
    }

    /// The first part of [`Chain::backward`]: heads, ups, blocks. Returns the gradient of the map's rows.
    pub fn backward_map(
        &self,
        parameters: &[f32],
        plan: &Plan,
        labelled: &[u32],
        pass: &Pass,
        outputs: &OutputGradients,
        gradients: &mut [f32],
        pool: &mut Pool,
    ) -> Vec<f32> {
        let [mut d1, mut d2] =
            self.backward_heads(parameters, plan, labelled, pass, outputs, gradients, pool);
        let [tail1, tail2] = self.tails(plan);
        let [rows1, rows2] = &plan.map.identity;
        let (middle, half) = (last(&pass.block1), last(&pass.block2));
        self.up2.backward(
            parameters, gradients, half, &pass.up2, rows2, tail2, &mut d2,
        );
        let mut half_gradient = pool.take(half.len());
        self.up2
            .input_gradient(parameters, &d2, rows2, &mut half_gradient, pool);
        pool.give(d2);
        let from_block2 = self.backward_block(
            &self.block2,
            parameters,
            gradients,
            middle,
            &pass.block2,
            &plan.map.block2,
            half_gradient,
            pool,
        );
        self.up1.backward(
            parameters, gradients, middle, &pass.up1, rows1, tail1, &mut d1,
        );
        let mut middle_gradient = pool.take(middle.len());
        self.up1
            .input_gradient(parameters, &d1, rows1, &mut middle_gradient, pool);
        pool.give(d1);
        add(&mut middle_gradient, &from_block2);
        pool.give(from_block2);
        self.backward_block(
            &self.block1,
            parameters,
            gradients,
            &pass.map,
            &pass.block1,
            &plan.map.block1,
            middle_gradient,
            pool,
        )
    }

    /// Gradients of up 1's and up 2's rows.
    fn backward_heads(
        &self,
        parameters: &[f32],
        plan: &Plan,
        labelled: &[u32],
        pass: &Pass,
        outputs: &OutputGradients,
        gradients: &mut [f32],
        pool: &mut Pool,
    ) -> [Vec<f32>; 2] {
        let head = &self.heads.presence;
        for row in outputs.presence[0].chunks_exact(head.cout) {
            add(&mut gradients[head.bias.clone()], row);
        }
        let halves = self.presence_halves();
        let ups = [
            (&pass.up1.y, self.up1.channels),
            (&pass.up2.y, self.up2.channels),
        ];
        let mut back = [0, 1].map(|i| {
            let (y, channels) = ups[i];
            let (weights, d) = (halves[i].clone(), &outputs.presence[i]);
            let rows = identity(y.len() / channels);
            weight_gradient(
                y,
                channels,
                &rows,
                d,
                head.cout,
                &mut gradients[weights.clone()],
            );
            let packed = Weights::pack_transposed(1, channels, head.cout, &parameters[weights]);
            let mut to = pool.take(y.len());
            convolve(d, &rows, &packed, Epilogue::default(), None, &mut to);
            to
        });
        let rows = identity(labelled.len());
        let features = &pass.labelled_features;
        let mut d = vec![0.0; features.len()];
        for (head, output) in self.heads.closer().zip(outputs.closer()) {
            head.backward(parameters, gradients, features, &rows, output, &mut d);
        }
        let (width1, width2) = (self.up1.channels, self.up2.channels);
        for (&cell, d) in labelled.iter().zip(d.chunks_exact(width1 + width2)) {
            let (row1, row2) = (
                plan.map.up1_row[cell as usize],
                plan.map.up2_row[cell as usize],
            );
            add(
                &mut back[0][row1 as usize * width1..][..width1],
                &d[..width1],
            );
            add(
                &mut back[1][row2 as usize * width2..][..width2],
                &d[width1..],
            );
        }
        back
    }

    /// Gradient of a block's input, from that of its output.
    fn backward_block(
        &self,
        layers: &[Layer],
        parameters: &[f32],
        gradients: &mut [f32],
        input: &[f32],
        activations: &[Activation],
        steps: &[Step],
        mut gradient: Vec<f32>,
        pool: &mut Pool,
    ) -> Vec<f32> {
        for (number, (layer, step)) in layers.iter().zip(steps).enumerate().rev() {
            let input = number.checked_sub(1).map_or(input, |n| &activations[n].y);
            let (gather, tail) = (&step.gather, tail_of(step));
            layer.backward(
                parameters,
                gradients,
                input,
                &activations[number],
                gather,
                tail,
                &mut gradient,
            );
            let mut to = pool.take(input.len());
            let listed = step.transposed.outputs() * layer.cin;
            layer.input_gradient(
                parameters,
                &gradient,
                &step.transposed,
                &mut to[..listed],
                pool,
            );
            if let Some(background) = step.background {
                let row = &mut to[listed..];
                layer.background_gradient(parameters, &gradient, gather, background, row);
            }
            pool.give(std::mem::replace(&mut gradient, to));
        }
        gradient
    }

    /// The second part of [`Chain::backward`], from the gradient of the map's rows: sparse layers.
    pub fn backward_sparse(
        &self,
        parameters: &[f32],
        plan: &Plan,
        pass: &Pass,
        map: &[f32],
        gradients: &mut [f32],
        pool: &mut Pool,
    ) {
        let Some(output) = self.sparse.last() else {
            return;
        };
        let (width, channels) = (self.network.map_channels(), output.channels);
        let depth = width / channels;
        let mut gradient = pool.take(plan.map.scatter.len() * channels);
        for ((row, z), to) in plan
            .map
            .scatter
            .iter()
            .zip(gradient.chunks_exact_mut(channels))
        {
            let cell = &map[*row as usize * width..][..width];
            let level = cell[*z as usize..].iter().step_by(depth);
            to.iter_mut().zip(level).for_each(|(to, from)| *to = *from);
        }
        for (number, layer) in self.sparse.iter().enumerate().rev() {
            let input = number
                .checked_sub(1)
                .map_or(&plan.sparse.voxels, |n| &pass.sparse[n].y);
            let (gather, tail) = (&plan.sparse.gathers[number], Tail::default());
            layer.backward(
                parameters,
                gradients,
                input,
                &pass.sparse[number],
                gather,
                tail,
                &mut gradient,
            );
            if number > 0 {
                let mut to = pool.take(input.len());
                layer.input_gradient(
                    parameters,
                    &gradient,
                    &plan.sparse.transposed[number],
                    &mut to,
                    pool,
                );
                pool.give(std::mem::replace(&mut gradient, to));
            }
        }
        pool.give(gradient);
    }
}
