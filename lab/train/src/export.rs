//! The trained network as a model file.

use crate::{error::TrainError, layers::Layer, network::Chain, trainer::TrainState};
use mluc_backbone::Backbone;
use mluc_head::Head;
use mluc_model::{Manifest, WeightSet, expected_tensors};
use std::ops::Range;

/// Weights in the axis order of the model file.
pub fn weights(chain: &Chain, state: &TrainState) -> WeightSet {
    let mut set = WeightSet::new();
    let mut expected = expected_tensors(&chain.network).into_iter();
    let mut put = |values: &[f32]| {
        if let Some((name, shape)) = expected.next() {
            set.insert(name, shape, values.to_vec());
        }
    };
    let part = |range: &Range<usize>| &state.parameters[range.clone()];
    let turned = |range: &Range<usize>, axes: Axes| -> Vec<f32> {
        let plain = part(range);
        (0..plain.len()).map(|i| plain[place(axes, i)]).collect()
    };
    for layer in chain.layers() {
        put(&turned(&layer.weight, axes(chain, layer)));
        put(part(&layer.gamma));
        put(part(&layer.beta));
        put(&state.running[layer.norm].mean);
        put(&state.running[layer.norm].var);
    }
    for head in chain.heads.all() {
        let axes = [(head.cout, 1), (head.cin, head.cout), (1, 0)];
        put(&turned(&head.weight, axes));
        put(part(&head.bias));
    }
    set
}

/// The axes of a layer's weights in a file, slowest first: length, and stride in `[tap][in][out]` (up layers:
/// `[in][place][out]`).
pub(crate) type Axes = [(usize, usize); 3];

/// The axes of a layer.
pub(crate) fn axes(chain: &Chain, layer: &Layer) -> Axes {
    let (taps, cin, cout, channels) = (layer.taps, layer.cin, layer.cout, layer.channels);
    let (output, input, tap) = ((cout, 1), (cin, cout), (taps, cin * cout));
    if layer.norm < chain.sparse.len() {
        [output, tap, input]
    } else if layer.norm + 2 < chain.layers().count() {
        [output, input, tap]
    } else {
        [input, (channels, 1), (cout / channels, channels)]
    }
}

/// Index in memory of the file's `i`-th value.
pub(crate) fn place([(_, first), (count, second), (last_count, last)]: Axes, i: usize) -> usize {
    let (rest, z) = (i / last_count, i % last_count);
    rest / count * first + rest % count * second + z * last
}

/// The largest objectness (for a sigmoid head, class probability) that a network outputs for a scan without points.
pub fn empty_objectness_max(manifest: &Manifest, weights: &WeightSet) -> Result<f32, TrainError> {
    let rows = Backbone::new(manifest, weights)?.empty_rows()?;
    let head = Head::new(manifest, weights)?;
    Ok(head.objectness_max(&rows))
}
