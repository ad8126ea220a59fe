//! Random sites and the rulebook of one layer, for the tests of this crate.

use crate::{rulebook::gather, rulebook::output_sites, sites::Sites};
use mluc_geometry::Random;
use mluc_kernels::Gather;
use mluc_model::SparseLayer;

/// At most `count` sites anywhere on a grid.
pub(crate) fn random_sites(shape: [usize; 3], count: usize, seed: u64) -> Sites {
    let mut sites = Sites::new(shape);
    let mut random = Random::from_state(seed);
    for _ in 0..count {
        let [z, y, x] = shape.map(|edge| random.below(edge));
        sites.insert(z, y, x);
    }
    sites.finish();
    sites
}

/// A layer's output sites (for a submanifold layer its input's sites) and its gather.
pub(crate) fn rulebook(layer: &SparseLayer, input: &Sites) -> (Sites, Gather) {
    let mut output = input.clone();
    if !layer.submanifold {
        output = Sites::new(layer.output_shape(input.shape()));
        output_sites(layer, input, &mut output);
    }
    let mut table = Gather::default();
    gather(layer, input, &output, &mut table);
    (output, table)
}
