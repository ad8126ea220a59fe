//! Points to feature rows: the stage as one function.

use mluc_model::{Manifest, ModelError, WeightSet};

use crate::bev;
use crate::cells::CellSet;
use crate::features::Features;
use crate::plane::{Coverage, PlaneLayer};
use crate::sparse::SparsePart;
use crate::trace::{Level, Observer, Place};
use crate::voxelize::PointCounts;

/// Why the backbone cannot run.
#[derive(Debug, thiserror::Error)]
pub enum BackboneError {
    /// The model does not fit.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// [`Backbone::write_rows`] was given room for another number of values.
    #[error("features: room for {expected} {what} needed, {found} given")]
    Room {
        /// `cells` or `values`.
        what: &'static str,
        /// As [`Frame::rows`] says.
        expected: usize,
        /// Length of the slice.
        found: usize,
    },
}

/// What a frame gave.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Frame {
    /// What became of the points.
    pub points: PointCounts,
    /// Feature rows to be written.
    pub rows: usize,
}

/// The network up to its feature rows, with all memory of a frame.
///
/// [`Backbone::run`] computes a frame and says how many rows it has; [`Backbone::write_rows`] computes the last layers
/// straight into the caller's memory. The same bits with any number of threads of rayon's ambient pool.
#[derive(Clone, Debug)]
pub struct Backbone {
    sparse: SparsePart,
    /// The bird's-eye map; zero outside `occupied`.
    map: Vec<f32>,
    map_channels: usize,
    occupied: CellSet,
    block1: Vec<PlaneLayer>,
    block2: Vec<PlaneLayer>,
    features: Features,
    feature_channels: usize,
}

impl Backbone {
    /// Checks the model, packs its weights and computes its response to an empty scene.
    pub fn new(manifest: &Manifest, weights: &WeightSet) -> Result<Backbone, BackboneError> {
        manifest.validate()?;
        weights.check(&manifest.network)?;
        let network = &manifest.network;
        let shape = network.map_shape();
        let block = |layers: &[mluc_model::DenseLayer], mut shape: [usize; 2]| {
            let layers = layers.iter().map(|layer| {
                let built = PlaneLayer::new(layer, shape, weights)?;
                shape = built.active().shape();
                Ok(built)
            });
            layers.collect::<Result<Vec<_>, ModelError>>()
        };
        let mut backbone = Backbone {
            sparse: SparsePart::new(manifest, weights)?,
            map: vec![0.0; shape[0] * shape[1] * network.map_channels()],
            map_channels: network.map_channels(),
            occupied: CellSet::new(shape),
            block1: block(&network.block1, shape)?,
            block2: block(&network.block2, shape)?,
            features: Features::new(network, weights)?,
            feature_channels: network.feature_channels(),
        };
        backbone
            .block1
            .iter_mut()
            .take(1)
            .for_each(PlaneLayer::reads_sparse_map);
        backbone.run_observed(&[], Coverage::Everywhere, &mut |_| ());
        backbone
            .block1
            .iter_mut()
            .chain(&mut backbone.block2)
            .for_each(PlaneLayer::store_empty);
        Ok(backbone)
    }

    /// Rows (y) and columns (x) of the bird's-eye map.
    pub fn map_shape(&self) -> [usize; 2] {
        self.occupied.shape()
    }

    /// Channels of a feature row.
    pub fn feature_channels(&self) -> usize {
        self.feature_channels
    }

    /// Feature rows of the last frame.
    pub fn rows(&self) -> usize {
        self.features.cells().len()
    }

    /// Computes a frame. `points`: x, y, z in m in the sensor frame, intensity 0..1, in the sensor's order.
    pub fn run(&mut self, points: &[[f32; 4]]) -> Frame {
        self.run_observed(points, Coverage::Active, &mut |_| ())
    }

    /// [`Backbone::run`] that shows every level and may compute all cells.
    pub fn run_observed(
        &mut self,
        points: &[[f32; 4]],
        coverage: Coverage,
        observe: Observer,
    ) -> Frame {
        let points = self.sparse.run(points, observe);
        self.fold_height();
        observe(self.map_level());
        let (mut values, mut active) = (&self.map[..], &self.occupied);
        for layer in self.block1.iter_mut().chain(&mut self.block2) {
            layer.run(values, active, coverage);
            (values, active) = (layer.values(), layer.active());
            let place = Place::Map(active.shape());
            observe(Level {
                name: &layer.name,
                place,
                channels: layer.channels(),
                values,
            });
        }
        self.features.place(active);
        Frame {
            points,
            rows: self.rows(),
        }
    }

    /// Writes the last frame's rows: `cells` (row * columns + column of the map, ascending; one a row) and `rows`
    /// ([`Backbone::feature_channels`] values a cell). A cell without a row equals the response to an empty scene.
    pub fn write_rows(&self, cells: &mut [u32], rows: &mut [f32]) -> Result<(), BackboneError> {
        let found = self.features.cells();
        for (what, expected, given) in [
            ("cells", found.len(), cells.len()),
            ("values", found.len() * self.feature_channels, rows.len()),
        ] {
            if expected != given {
                return Err(BackboneError::Room {
                    what,
                    expected,
                    found: given,
                });
            }
        }
        cells.copy_from_slice(found);
        // A checked network has layers in both blocks.
        if let (Some(block1), Some(block2)) = (self.block1.last(), self.block2.last()) {
            self.features.write(block1, block2, rows);
        }
        Ok(())
    }

    /// The response to an empty scene: one feature row for every cell of the map, in order.
    pub fn empty_rows(&mut self) -> Result<Vec<f32>, BackboneError> {
        let frame = self.run_observed(&[], Coverage::Everywhere, &mut |_| ());
        let (mut cells, mut rows) = (
            vec![0; frame.rows],
            vec![0.0; frame.rows * self.feature_channels],
        );
        self.write_rows(&mut cells, &mut rows)?;
        Ok(rows)
    }

    /// The sparse part's last sites become the bird's-eye map.
    fn fold_height(&mut self) {
        let channels = self.map_channels;
        for cell in self.occupied.list() {
            self.map[*cell as usize * channels..][..channels].fill(0.0);
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

    fn map_level(&self) -> Level<'_> {
        let place = Place::Map(self.occupied.shape());
        Level {
            name: "bev",
            place,
            channels: self.map_channels,
            values: &self.map,
        }
    }
}
