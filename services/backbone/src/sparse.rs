//! The sparse 3-D part on one scan (paper section 3.1): voxels, then every layer over its rulebook.

use crate::trace::{Place, Watch};
use crate::voxelize::{NEAREST_SQUARED, POINTS_A_TASK, PointCounts, VOXEL_CHANNELS, Voxels};
use crate::voxelize::{localize, voxelize};
use crate::{convolution::Convolution, precision::Value, quant_scale::QuantScale, sites::Sites};
use crate::{error::BackboneError, error::Result, rulebooks::Rulebooks};
use mluc_geometry::ground::{GroundGrid, ground_height_m};
use mluc_ipc_types::POINTS_MAX;
use mluc_model::{Folded, Manifest, Network, VoxelInput, WeightSet};
use rayon::prelude::*;

/// Layers and the memory of one frame.
#[derive(Clone, Debug)]
pub(crate) struct SparsePart<V: Value> {
    network: Network,
    uses_intensity: bool,
    /// The ground finder of a network with local input.
    ground: Option<GroundGrid>,
    /// The scan with the height above the ground as z.
    levelled: Vec<[f32; 4]>,
    /// The first layer reads coordinates, so it is f32 in every precision.
    first: Convolution<f32>,
    others: Vec<Convolution<V>>,
    /// Scale of each layer's output.
    scale: Vec<QuantScale>,
    voxels: Voxels,
    books: Rulebooks,
    /// Output of the last layer that ran (`rows`), and of the layer before it (`spare`).
    pub(crate) rows: Vec<V>,
    spare: Vec<V>,
}

impl<V: Value> SparsePart<V> {
    /// From a checked manifest, which has at least one sparse layer. `scale`: gives the scale of a layer's output by its name and channels.
    pub(crate) fn new(
        manifest: &Manifest,
        weights: &WeightSet,
        scale: impl Fn(&str, usize) -> Result<QuantScale>,
    ) -> Result<SparsePart<V>> {
        let network = manifest.network.clone();
        let outputs = network.sparse.iter().map(|layer| scale(&layer.name, layer.cout));
        let outputs = outputs.collect::<Result<Vec<_>>>()?;
        let folded = |number: usize| {
            let layer = Folded::sparse(weights, &network.sparse[number])?;
            let before = match number {
                0 => &QuantScale::identity(),
                _ => &outputs[number - 1],
            };
            Ok::<_, BackboneError>(QuantScale::between(before, &outputs[number], layer))
        };
        let others = (1..outputs.len()).map(|number| Ok(Convolution::new(&folded(number)?)));
        let sites_max = network.sites_max();
        let outputs_max = sites_max[1..].iter().zip(&network.sparse);
        let values_max = outputs_max.map(|(sites, layer)| sites * layer.cout).max();
        let room = || Vec::with_capacity(values_max.unwrap_or(0));
        let is_local = network.input == VoxelInput::Local;
        Ok(SparsePart {
            first: Convolution::new(&folded(0)?),
            others: others.collect::<Result<_>>()?,
            voxels: Voxels::new(&network.grid),
            books: Rulebooks::new(&network),
            uses_intensity: manifest.uses_intensity,
            ground: is_local.then(|| GroundGrid::new(manifest.sensor_height_m.into())),
            levelled: Vec::with_capacity(if is_local { POINTS_MAX } else { 0 }),
            scale: outputs,
            rows: room(),
            spare: room(),
            network,
        })
    }

    pub(crate) fn run(&mut self, points: &[[f32; 4]], watch: &mut Watch) -> PointCounts {
        let (network, voxels, books) = (&self.network, &mut self.voxels, &mut self.books);
        let (rows, spare) = (&mut self.rows, &mut self.spare);
        let counts = match &mut self.ground {
            None => voxelize(points, &network.grid, self.uses_intensity, voxels),
            Some(ground) => {
                level(points, ground.find(points), &mut self.levelled);
                watch.step("ground", 0);
                let counts = voxelize(&self.levelled, &network.grid, false, voxels);
                localize(&network.grid, voxels);
                counts
            }
        };
        let place = Place::Sites(&voxels.sites);
        watch.step("voxels", voxels.sites.len());
        let values = (&voxels.rows[..], &QuantScale::identity());
        watch.level("voxels", place, VOXEL_CHANNELS, values);
        books.build(network, &voxels.sites);
        watch.step("rulebooks", 0);
        for (number, layer) in network.sparse.iter().enumerate() {
            let sites = books.sites_after(number, &voxels.sites);
            spare.resize(sites.len() * layer.cout, V::default());
            match number {
                0 => self.first.run(&voxels.rows, books.gather(0), None, spare),
                _ => self.others[number - 1].run(rows, books.gather(number), None, spare),
            }
            std::mem::swap(rows, spare);
            watch.layer(&layer.name, sites.len(), &|| [books.gather(number).products(); 2]);
            let values = (&rows[..], &self.scale[number]);
            watch.level(&layer.name, Place::Sites(sites), layer.cout, values);
        }
        counts
    }

    /// The last scan's ground ([`mluc_geometry::ground::GROUND_NODES`] heights, m); empty unless the network's input is local.
    pub(crate) fn ground_m(&self) -> &[f32] {
        self.ground.as_ref().map_or(&[], GroundGrid::heights_m)
    }

    pub(crate) fn sites(&self) -> &Sites {
        self.books.sites_after(self.others.len(), &self.voxels.sites)
    }

    pub(crate) fn scale(&self) -> &QuantScale {
        &self.scale[self.others.len()]
    }
}

/// Copies the points with their height above the ground as z; a point at the origin gets a height out of range.
fn level(points: &[[f32; 4]], ground_m: &[f32], levelled: &mut Vec<[f32; 4]>) {
    levelled.resize(points.len(), [0.0; 4]);
    let chunks = levelled.par_chunks_mut(POINTS_A_TASK);
    chunks.zip(points.par_chunks(POINTS_A_TASK)).for_each(|(levelled, points)| {
        for (levelled, &[x, y, z, intensity]) in levelled.iter_mut().zip(points) {
            let is_return = x * x + y * y + z * z >= NEAREST_SQUARED;
            let ground_m = if is_return { ground_height_m(ground_m, [x, y]) } else { f32::MIN };
            *levelled = [x, y, z - ground_m, intensity];
        }
    });
}
