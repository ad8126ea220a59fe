//! The rulebooks of the whole sparse part for one scan.

use crate::{rulebook::gather, rulebook::output_sites, sites::Sites};
use mluc_kernels::Gather;
use mluc_model::Network;

/// The rulebooks of a network's whole sparse part for one scan; reused from frame to frame.
///
/// Submanifold layers of one resolution and kernel share one gather.
#[derive(Clone, Debug, Default)]
pub struct Rulebooks {
    /// Sites of resolutions 1 and later; resolution 0 belongs to the voxels.
    resolutions: Vec<Sites>,
    gathers: Vec<Gather>,
    /// For each layer: its gather, and the resolution after it.
    layers: Vec<(usize, usize)>,
    /// For each gather: the layer that it is built from, and that layer's input resolution.
    sources: Vec<(usize, usize)>,
}

impl Rulebooks {
    /// Reserves memory for `network` and any scan; a page is not touched before a scan needs it.
    pub fn new(network: &Network) -> Rulebooks {
        let mut books = Rulebooks::default();
        let sites_max = network.sites_max();
        let mut resolution = 0;
        for (number, layer) in network.sparse.iter().enumerate() {
            let known = books.sources.iter().position(|&(source, at)| {
                let source = &network.sparse[source];
                let are_same = at == resolution && source.kernel == layer.kernel;
                are_same && layer.submanifold && source.submanifold
            });
            let gather = known.unwrap_or_else(|| {
                books.sources.push((number, resolution));
                let taps = Vec::with_capacity(sites_max[number + 1] * layer.taps());
                books.gathers.push(Gather::new(layer.taps(), taps));
                books.gathers.len() - 1
            });
            if !layer.submanifold {
                let input = network.sparse_shapes()[number];
                let mut sites = Sites::new(layer.output_shape(input));
                sites.reserve(sites_max[number + 1]);
                books.resolutions.push(sites);
                resolution += 1;
            }
            books.layers.push((gather, resolution));
        }
        books
    }

    /// Builds every table for the scan whose voxels lie at `voxels`.
    pub fn build(&mut self, network: &Network, voxels: &Sites) {
        for (&(layer, resolution), table) in self.sources.iter().zip(&mut self.gathers) {
            let layer = &network.sparse[layer];
            let (before, after) = self.resolutions.split_at_mut(resolution);
            let input = before.last().unwrap_or(voxels);
            match after.first_mut().filter(|_| !layer.submanifold) {
                None => gather(layer, input, input, table),
                Some(output) => {
                    output_sites(layer, input, output);
                    gather(layer, input, output, table);
                }
            }
        }
    }

    /// The gather of layer `layer`.
    pub fn gather(&self, layer: usize) -> &Gather {
        &self.gathers[self.layers[layer].0]
    }

    /// The sites after layer `layer`; `voxels` are the sites before the first.
    pub fn sites_after<'a>(&'a self, layer: usize, voxels: &'a Sites) -> &'a Sites {
        match self.layers[layer].1 {
            0 => voxels,
            resolution => &self.resolutions[resolution - 1],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{random_sites, rulebook};
    use mluc_model::Grid;

    #[test]
    fn a_networks_books_are_those_of_its_layers_also_in_reused_memory() {
        let grid = Grid::kitti_compact().within([0.0, 12.8], [-40.0, -30.4]);
        let network = Network::compact(grid, 3);
        let mut books = Rulebooks::new(&network);
        for seed in 0..3 {
            let voxels = random_sites(network.grid.sparse_shape(), 900, seed);
            books.build(&network, &voxels);
            let mut sites = voxels.clone();
            for (number, layer) in network.sparse.iter().enumerate() {
                let (output, table) = rulebook(layer, &sites);
                sites = output;
                assert_eq!(books.gather(number), &table, "{}", layer.name);
                let found = books.sites_after(number, &voxels);
                assert_eq!(found.coordinates(), sites.coordinates());
            }
        }
    }
}
