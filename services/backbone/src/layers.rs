//! The network up to its feature rows, in one precision.

use mluc_model::{DenseLayer, Manifest, WeightSet};

use crate::bev;
use crate::cells::CellSet;
use crate::error::BackboneError;
use crate::features::Features;
use crate::frame::Frame;
use crate::plane::{Coverage, PlaneLayer};
use crate::precision::Value;
use crate::quant_scale::QuantScale;
use crate::sparse::SparsePart;
use crate::trace::{Place, Reads, Watch};

/// All layers, with all memory of a frame; `V` is what the rows between them hold.
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
    feature_channels: usize,
}

impl<V: Value> Layers<V> {
    /// Of a checked model. `scale`: of a layer's output, by its name and channels.
    pub(crate) fn new(
        manifest: &Manifest,
        weights: &WeightSet,
        scale: impl Fn(&str, usize) -> Result<QuantScale, BackboneError>,
    ) -> Result<Layers<V>, BackboneError> {
        let network = &manifest.network;
        let shape = network.map_shape();
        let sparse = SparsePart::new(manifest, weights, &scale)?;
        let depth = sparse.sites().shape()[0];
        let map_scale = sparse.scale().repeated(depth);
        type Before = ([usize; 2], QuantScale, Vec<f32>);
        let block = |layers: &[DenseLayer],
                     sparse_map,
                     (mut shape, mut before, mut empty_response): Before| {
            let layers = layers.iter().enumerate().map(|(number, layer)| {
                let own = scale(&layer.name, layer.cout)?;
                let reads = (shape, sparse_map && number == 0);
                let built = PlaneLayer::new(
                    layer,
                    reads,
                    weights,
                    (&before, own.clone()),
                    &empty_response,
                )?;
                (shape, before, empty_response) =
                    (built.active().shape(), own, built.empty_response().to_vec());
                Ok(built)
            });
            let layers = layers.collect::<Result<Vec<_>, BackboneError>>()?;
            Ok::<_, BackboneError>((layers, before, empty_response))
        };
        // The map of an empty scene is 0.
        let empty = vec![0.0; network.map_channels()];
        let (block1, units1, usual1) =
            block(&network.block1, true, (shape, map_scale.clone(), empty))?;
        let before = (shape, units1.clone(), usual1.clone());
        let (block2, units2, usual2) = block(&network.block2, false, before)?;
        let ends = [(&units1, &usual1[..]), (&units2, &usual2[..])];
        let mut layers = Layers {
            sparse,
            map: vec![V::default(); shape[0] * shape[1] * network.map_channels()],
            map_scale,
            map_channels: network.map_channels(),
            occupied: CellSet::new(shape),
            block1,
            block2,
            features: Features::new(network, weights, ends)?,
            feature_channels: network.feature_channels(),
        };
        layers.run(&[], Coverage::Everywhere, &mut Watch::Nobody);
        let all = layers.block1.iter_mut().chain(&mut layers.block2);
        all.for_each(PlaneLayer::store_empty);
        Ok(layers)
    }

    pub(crate) fn map_shape(&self) -> [usize; 2] {
        self.occupied.shape()
    }

    pub(crate) fn feature_channels(&self) -> usize {
        self.feature_channels
    }

    /// Cells of the last frame's feature rows, ascending.
    pub(crate) fn cells(&self) -> &[u32] {
        self.features.cells()
    }

    pub(crate) fn run(
        &mut self,
        points: &[[f32; 4]],
        coverage: Coverage,
        watch: &mut Watch,
    ) -> Frame {
        let points = self.sparse.run(points, watch);
        self.fold_height();
        let place = Place::Map(self.map_shape());
        watch.step("bev", self.occupied.list().len(), Reads::Nothing);
        let values = (&self.map[..], &self.map_scale);
        watch.level("bev", place, self.map_channels, values);
        let (mut values, mut active) = (&self.map[..], &self.occupied);
        for layer in self.block1.iter_mut().chain(&mut self.block2) {
            layer.run(values, active, coverage);
            (values, active) = (layer.values(), layer.active());
            watch.step(&layer.name, active.list().len(), layer.reads());
            let place = Place::Map(active.shape());
            let shown = (values, layer.scale());
            watch.level(&layer.name, place, layer.channels(), shown);
        }
        self.features.place(active);
        watch.step("rows", self.cells().len(), Reads::Nothing);
        Frame {
            points,
            rows: self.cells().len(),
        }
    }

    /// The last frame's feature rows, one for each of [`Layers::cells`].
    pub(crate) fn write(&self, rows: &mut [f32]) {
        // A checked network has layers in both blocks.
        if let (Some(block1), Some(block2)) = (self.block1.last(), self.block2.last()) {
            self.features.write(block1, block2, rows);
        }
    }

    /// The sparse part's last sites become the bird's-eye map.
    fn fold_height(&mut self) {
        let channels = self.map_channels;
        for cell in self.occupied.list() {
            self.map[*cell as usize * channels..][..channels].fill(V::default());
        }
        let sites = self.sparse.sites();
        self.occupied.assign(
            sites
                .coordinates()
                .iter()
                .map(|[_, y, x]| [usize::from(*y), usize::from(*x)]),
        );
        bev::scatter(
            sites,
            self.sparse.rows(),
            channels / sites.shape()[0],
            &mut self.map,
        );
    }
}
