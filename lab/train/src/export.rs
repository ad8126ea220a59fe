//! The trained network as a model file.

use mluc_kernels::Gather;
use mluc_model::WeightSet;

use crate::layers::{Layer, LayerPlan, Linear};
use crate::network::{Chain, StepInput};
use crate::plan::{MapPlan, Plan, SparsePlan};
use crate::pool::Pool;
use crate::trainer::TrainState;

/// Weights in the model file's order of axes.
pub fn weights(chain: &Chain, state: &TrainState) -> WeightSet {
    let mut set = WeightSet::new();
    let parameters = &state.parameters;
    for (layer, order) in chain.layers().zip(orders(chain)) {
        let shape = match order {
            AxisOrder::OutTapIn => {
                let [z, y, x] = chain.network.sparse[layer.norm].kernel;
                vec![layer.cout, z, y, x, layer.cin]
            }
            AxisOrder::OutInTap => vec![layer.cout, layer.cin, 3, 3],
            AxisOrder::InOutCopy => {
                let factor = if layer.cout > layer.channels { 2 } else { 1 };
                vec![layer.cin, layer.channels, factor, factor]
            }
        };
        let plain = &parameters[layer.weight.clone()];
        let values = (0..plain.len()).map(|i| plain[place(layer, order, i)]);
        set.insert(format!("{}.weight", layer.name), shape, values.collect());
        let statistics = &state.running[layer.norm];
        for (name, values) in [
            ("weight", &parameters[layer.gamma.clone()]),
            ("bias", &parameters[layer.beta.clone()]),
            ("running_mean", &statistics.mean),
            ("running_var", &statistics.var),
        ] {
            let name = format!("{}.bn.{name}", layer.name);
            set.insert(name, vec![layer.channels], values.to_vec());
        }
    }
    for head in chain.heads.all() {
        insert_head(&mut set, head, parameters);
    }
    set
}

fn insert_head(set: &mut WeightSet, head: &Linear, parameters: &[f32]) {
    let Linear { cin, cout, .. } = *head;
    let weight = &parameters[head.weight.clone()];
    let values = (0..cin * cout).map(|i| weight[i % cin * cout + i / cin]);
    let name = |part: &str| format!("{}.{part}", head.name);
    set.insert(name("weight"), vec![cout, cin, 1, 1], values.collect());
    let bias = parameters[head.bias.clone()].to_vec();
    set.insert(name("bias"), vec![cout], bias);
}

/// Orders of the axes in a file, slowest first.
#[derive(Clone, Copy, Debug)]
pub(crate) enum AxisOrder {
    /// Sparse: out, taps, in.
    OutTapIn,
    /// Dense: out, in, taps.
    OutInTap,
    /// Up: in, out, place in the 2x2.
    InOutCopy,
}

/// Where the file's `i`-th value lies in `[tap][in][out]` (up: `[in][place][out]`).
pub(crate) fn place(layer: &Layer, order: AxisOrder, i: usize) -> usize {
    let (taps, cin, cout, channels) = (layer.taps, layer.cin, layer.cout, layer.channels);
    let copies = cout / channels;
    match order {
        AxisOrder::OutTapIn => (i / cin % taps * cin + i % cin) * cout + i / (cin * taps),
        AxisOrder::OutInTap => (i % taps * cin + i / taps % cin) * cout + i / (cin * taps),
        AxisOrder::InOutCopy => i / cout * cout + i % copies * channels + i / copies % channels,
    }
}

/// The order of each layer's axes in the file, in the order of [`Layer::norm`].
pub(crate) fn orders(chain: &Chain) -> Vec<AxisOrder> {
    let dense = chain.block1.len() + chain.block2.len();
    let mut orders = vec![AxisOrder::OutTapIn; chain.sparse.len()];
    orders.extend(vec![AxisOrder::OutInTap; dense]);
    orders.extend([AxisOrder::InOutCopy; 2]);
    orders
}

/// The largest objectness (of a sigmoid head, class probability) that the network gives to a scan without points.
pub fn empty_objectness_max(chain: &Chain, state: &TrainState) -> f32 {
    let empty = |layer: &Layer| LayerPlan {
        gather: Gather::new(layer.taps, vec![]),
        ..LayerPlan::default()
    };
    let sparse = SparsePlan {
        voxels: vec![],
        layers: chain.sparse.iter().map(empty).collect(),
    };
    let map = MapPlan::new(&chain.network, 1, &[]);
    let plan = Plan { sparse, map };
    let input = StepInput {
        running: Some(&state.running),
        ..StepInput::new(&state.parameters, &plan, &[])
    };
    let pass = chain.forward(&input, &mut Pool::default());
    let anchors = chain.heads.presence.cout;
    let [up1, up2] = &pass.outputs.presence;
    let mut most = f32::MIN;
    for cell in 0..plan.map.cells() {
        let [row1, row2] = plan.map.up_rows(cell).map(|row| row * anchors);
        for a in 0..anchors {
            most = most.max(up1[row1 + a] + up2[row2 + a]);
        }
    }
    1.0 / (1.0 + (-most).exp())
}
