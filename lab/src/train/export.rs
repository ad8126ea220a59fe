//! The trained network as a model file.

use mluc_kernels::Gather;
use mluc_model::{Manifest, WeightSet};

use super::layers::{Layer, Linear, Pool};
use super::network::{Chain, Running};
use super::plan::{MapPlan, Plan, SparsePlan};

/// Weights in the model file's order of axes.
pub fn weights(chain: &Chain, parameters: &[f32], running: &Running) -> WeightSet {
    let mut set = WeightSet::new();
    let network = &chain.network;
    for (layer, description) in chain.sparse.iter().zip(&network.sparse) {
        let [z, y, x] = description.kernel;
        let shape = vec![layer.cout, z, y, x, layer.cin];
        set.insert(
            format!("{}.weight", layer.name),
            shape,
            reorder(layer, parameters, Order::OutTapIn),
        );
    }
    for layer in chain.block1.iter().chain(&chain.block2) {
        let shape = vec![layer.cout, layer.cin, 3, 3];
        set.insert(
            format!("{}.weight", layer.name),
            shape,
            reorder(layer, parameters, Order::OutInTap),
        );
    }
    for (layer, factor) in [(&chain.up1, 1), (&chain.up2, 2)] {
        let shape = vec![layer.cin, layer.channels, factor, factor];
        set.insert(
            format!("{}.weight", layer.name),
            shape,
            reorder(layer, parameters, Order::InOutCopy),
        );
    }
    for layer in chain.layers() {
        let statistics = &running[layer.norm];
        let values = [
            ("weight", parameters[layer.gamma.clone()].to_vec()),
            ("bias", parameters[layer.beta.clone()].to_vec()),
            ("running_mean", statistics.mean.clone()),
            ("running_var", statistics.variance.clone()),
        ];
        for (name, values) in values {
            set.insert(
                format!("{}.bn.{name}", layer.name),
                vec![layer.channels],
                values,
            );
        }
    }
    for head in chain.heads.all() {
        insert_head(&mut set, head, parameters);
    }
    set
}

fn insert_head(set: &mut WeightSet, head: &Linear, parameters: &[f32]) {
    let weight = &parameters[head.weight.clone()];
    let at = |i: usize| weight[i % head.cin * head.cout + i / head.cin];
    let values = (0..head.cin * head.cout).map(at).collect();
    set.insert(
        format!("{}.weight", head.name),
        vec![head.cout, head.cin, 1, 1],
        values,
    );
    set.insert(
        format!("{}.bias", head.name),
        vec![head.cout],
        parameters[head.bias.clone()].to_vec(),
    );
}

/// Orders of the axes, slowest first.
#[derive(Clone, Copy, Debug)]
pub(super) enum Order {
    /// Sparse: out, taps, in.
    OutTapIn,
    /// Dense: out, in, taps.
    OutInTap,
    /// Up: in, out, place in the 2x2.
    InOutCopy,
}

/// Where the file's `i`-th value lies in `[tap][in][out]` (up: `[in][place][out]`).
pub(super) fn place(layer: &Layer, order: Order, i: usize) -> usize {
    let (taps, cin, cout, channels) = (layer.taps, layer.cin, layer.cout, layer.channels);
    let copies = cout / channels;
    match order {
        Order::OutTapIn => (i / cin % taps * cin + i % cin) * cout + i / (cin * taps),
        Order::OutInTap => (i % taps * cin + i / taps % cin) * cout + i / (cin * taps),
        Order::InOutCopy => i / cout * cout + i % copies * channels + i / copies % channels,
    }
}

fn reorder(layer: &Layer, parameters: &[f32], order: Order) -> Vec<f32> {
    let plain = &parameters[layer.weight.clone()];
    (0..plain.len())
        .map(|i| plain[place(layer, order, i)])
        .collect()
}

/// The order of each layer's axes in the file, in the order of [`Layer::norm`].
pub(super) fn orders(chain: &Chain) -> Vec<Order> {
    let dense = chain.block1.len() + chain.block2.len();
    let mut orders = vec![Order::OutTapIn; chain.sparse.len()];
    orders.extend(vec![Order::OutInTap; dense]);
    orders.extend([Order::InOutCopy; 2]);
    orders
}

/// The largest objectness (of a sigmoid head, class probability) that the network gives to a scan without points.
pub fn empty_objectness_max(chain: &Chain, parameters: &[f32], running: &Running) -> f32 {
    let gather = |taps| Gather {
        taps,
        index: vec![],
    };
    let sparse = SparsePlan {
        voxels: vec![],
        gathers: chain.sparse.iter().map(|l| gather(l.taps)).collect(),
        transposed: vec![],
    };
    let plan = Plan {
        sparse,
        map: MapPlan::new(&chain.network, 1, &[]),
    };
    let pass = chain.forward(parameters, &plan, &[], Some(running), &mut Pool::default());
    let anchors = chain.heads.presence.cout;
    let [up1, up2] = &pass.presence;
    let rows = plan.map.up1_row.iter().zip(&plan.map.up2_row);
    let logits = rows.flat_map(|(a, b)| {
        let (a, b) = (*a as usize * anchors, *b as usize * anchors);
        up1[a..a + anchors]
            .iter()
            .zip(&up2[b..b + anchors])
            .map(|(x, y)| x + y)
    });
    1.0 / (1.0 + (-logits.fold(f32::MIN, f32::max)).exp())
}

/// Completes a manifest with what training found.
pub fn finish(
    mut manifest: Manifest,
    chain: &Chain,
    parameters: &[f32],
    running: &Running,
) -> Manifest {
    manifest.empty_objectness_max = empty_objectness_max(chain, parameters, running);
    manifest
}
