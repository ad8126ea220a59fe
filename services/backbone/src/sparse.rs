//! The sparse 3-D part on one scan (paper section 3.1): voxels, then every layer over its rulebook.

use mluc_model::{Folded, Manifest, ModelError, Network, WeightSet};

use crate::convolution::Convolution;
use crate::rulebooks::Rulebooks;
use crate::sites::Sites;
use crate::trace::{Level, Observer, Place};
use crate::voxelize::{PointCounts, VOXEL_CHANNELS, Voxels, voxelize};

/// Layers and the memory of one frame.
#[derive(Clone, Debug)]
pub(crate) struct SparsePart {
    network: Network,
    uses_intensity: bool,
    layers: Vec<Convolution>,
    voxels: Voxels,
    books: Rulebooks,
    /// Output of the last layer that ran, and of the one before.
    rows: Vec<f32>,
    spare: Vec<f32>,
}

impl SparsePart {
    pub(crate) fn new(manifest: &Manifest, weights: &WeightSet) -> Result<SparsePart, ModelError> {
        let network = manifest.network.clone();
        let layers = network
            .sparse
            .iter()
            .map(|layer| Ok(Convolution::new(&Folded::sparse(weights, layer)?)));
        Ok(SparsePart {
            layers: layers.collect::<Result<_, ModelError>>()?,
            voxels: Voxels::new(&network.grid),
            books: Rulebooks::new(&network),
            uses_intensity: manifest.uses_intensity,
            network,
            rows: vec![],
            spare: vec![],
        })
    }

    pub(crate) fn run(&mut self, points: &[[f32; 4]], observe: Observer) -> PointCounts {
        let SparsePart {
            network,
            layers,
            voxels,
            books,
            rows,
            spare,
            ..
        } = self;
        let counts = voxelize(points, &network.grid, self.uses_intensity, voxels);
        rows.clone_from(&voxels.rows);
        let place = Place::Sites(&voxels.sites);
        observe(Level {
            name: "voxels",
            place,
            channels: VOXEL_CHANNELS,
            values: rows,
        });
        books.build(network, &voxels.sites);
        for (number, layer) in layers.iter().enumerate() {
            let sites = books.sites_after(number, &voxels.sites);
            spare.resize(sites.len() * layer.cout(), 0.0);
            layer.run(rows, books.gather(number), None, spare);
            std::mem::swap(rows, spare);
            let name = &network.sparse[number].name;
            observe(Level {
                name,
                place: Place::Sites(sites),
                channels: layer.cout(),
                values: rows,
            });
        }
        counts
    }

    /// Sites of the last layer.
    pub(crate) fn sites(&self) -> &Sites {
        self.books
            .sites_after(self.layers.len() - 1, &self.voxels.sites)
    }

    /// The last layer's rows.
    pub(crate) fn rows(&self) -> &[f32] {
        &self.rows
    }
}
