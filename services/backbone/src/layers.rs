//! The network up to its feature rows, in one precision.

use crate::error::{BackboneError, Result};
use crate::plane::{Coverage, MapRows, PlaneLayer};
use crate::{cells::CellSet, features::Features, precision::Value, quant_scale::QuantScale};
use crate::{sites::Sites, sparse::SparsePart, trace::Place, trace::Watch, voxelize::PointCounts};
use mluc_model::{DenseLayer, Manifest, WeightSet};

/// The result of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Frame {
    /// Counts of the scan's points.
    pub points: PointCounts,
    /// Number of feature rows to be written.
    pub rows: usize,
}

/// All layers, with all memory of a frame; `V` is the value type of the rows between them.
#[derive(Clone, Debug)]
pub(crate) struct Layers<V: Value> {
    sparse: SparsePart<V>,
    /// The bird's-eye map; zero outside `occupied`.
    map: Vec<V>,
    map_scale: QuantScale,
    map_channels: usize,
    occupied: CellSet,
    block1: Vec<PlaneLayer<V>>,
    block2: Vec<PlaneLayer<V>>,
    features: Features<V>,
    pub(crate) feature_channels: usize,
}

impl<V: Value> Layers<V> {
    /// From a checked model. `scale`: gives the scale of a layer's output by the layer's name and channels.
    pub(crate) fn new(
        manifest: &Manifest,
        weights: &WeightSet,
        scale: impl Fn(&str, usize) -> Result<QuantScale>,
    ) -> Result<Layers<V>> {
        let network = &manifest.network;
        let shape = network.map_shape();
        let sparse = SparsePart::new(manifest, weights, &scale)?;
        let map_scale = sparse.scale().repeated(sparse.sites().shape()[0]);
        let halo_layers = network.halo_layers.unwrap_or(usize::MAX);
        let block = |layers: &[DenseLayer], first: usize, mut before: MapRows| {
            let mut block: Vec<PlaneLayer<V>> = Vec::with_capacity(layers.len());
            for (number, layer) in (first..).zip(layers) {
                let own = scale(&layer.name, layer.cout)?;
                let has_halo = number < halo_layers;
                let layer = PlaneLayer::new(layer, weights, &before, own, number == 0, has_halo)?;
                before = layer.output.clone();
                block.push(layer);
            }
            Ok::<_, BackboneError>((block, before))
        };
        let map = MapRows {
            shape,
            scale: map_scale.clone(),
            // The map of an empty scene is 0.
            empty_response: vec![0.0; network.map_channels()],
        };
        let (block1, end1) = block(&network.block1, 0, map)?;
        let (block2, end2) = block(&network.block2, network.block1.len(), end1.clone())?;
        let mut layers = Layers {
            sparse,
            map: vec![V::default(); shape[0] * shape[1] * network.map_channels()],
            map_scale,
            map_channels: network.map_channels(),
            occupied: CellSet::new(shape),
            block1,
            block2,
            features: Features::new(network, weights, [&end1, &end2])?,
            feature_channels: network.feature_channels(),
        };
        layers.run(&[], Coverage::Everywhere, &mut Watch::Nobody);
        let all = layers.block1.iter_mut().chain(&mut layers.block2);
        all.for_each(|layer| layer.empty.clone_from(&layer.values));
        Ok(layers)
    }

    pub(crate) fn map_shape(&self) -> [usize; 2] {
        self.occupied.shape
    }

    pub(crate) fn ground_m(&self) -> &[f32] {
        self.sparse.ground_m()
    }

    /// Cells of the last frame's feature rows, ascending.
    pub(crate) fn cells(&self) -> &[u32] {
        &self.features.cells.list
    }

    pub(crate) fn run(&mut self, points: &[[f32; 4]], over: Coverage, watch: &mut Watch) -> Frame {
        let points = self.sparse.run(points, watch);
        self.fold_height();
        let place = Place::Map(self.map_shape());
        watch.step("bev", self.occupied.list.len());
        let values = (&self.map[..], &self.map_scale);
        watch.level("bev", place, self.map_channels, values);
        let (mut values, mut active) = (&self.map, &self.occupied);
        for layer in self.block1.iter_mut().chain(&mut self.block2) {
            layer.run(values, active, over);
            (values, active) = (&layer.values, &layer.active);
            watch.layer(&layer.name, active.list.len(), &|| layer.products());
            let place = Place::Map(active.shape);
            let shown = (&values[..], &layer.output.scale);
            watch.level(&layer.name, place, layer.channels(), shown);
        }
        self.features.place(active);
        watch.step("rows", self.cells().len());
        Frame { points, rows: self.cells().len() }
    }

    /// The last frame's feature rows, one for each of [`Layers::cells`].
    pub(crate) fn write(&self, rows: &mut [f32]) {
        // A checked network has layers in both blocks.
        if let (Some(block1), Some(block2)) = (self.block1.last(), self.block2.last()) {
            self.features.write(block1, block2, rows);
        }
    }

    /// Writes the sparse part's last sites into the bird's-eye map.
    fn fold_height(&mut self) {
        let channels = self.map_channels;
        for cell in &self.occupied.list {
            self.map[*cell as usize * channels..][..channels].fill(V::default());
        }
        let sites = self.sparse.sites();
        let coordinates = sites.coordinates().iter();
        let places = coordinates.map(|[_, y, x]| [*y, *x].map(usize::from));
        self.occupied.assign(places);
        let site_channels = channels / sites.shape()[0];
        scatter(sites, &self.sparse.rows, site_channels, &mut self.map);
    }
}

/// Writes each site's row into its cell of `map`, one row per cell in (y, x) order; the other values stay unchanged. Heights
/// become channels: channel = c * depth + z (paper section 3.1: the height is folded into the channels, innermost).
fn scatter<T: Copy>(sites: &Sites, rows: &[T], channels: usize, map: &mut [T]) {
    let [depth, _, width] = sites.shape();
    for (site, row) in sites.coordinates().iter().zip(rows.chunks_exact(channels)) {
        let [z, y, x] = site.map(usize::from);
        let cell = &mut map[(y * width + x) * channels * depth..][..channels * depth];
        cell[z..].iter_mut().step_by(depth).zip(row).for_each(|(to, from)| *to = *from);
    }
}
