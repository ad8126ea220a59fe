//! Points to feature rows: the stage as one function.

use crate::error::{BackboneError, Result};
use crate::layers::{Frame, Layers};
use crate::trace::{Observer, Steps, Watch};
use crate::{plane::Coverage, precision::Precision, quant_scale::QuantScale, warm_up};
use mluc_kernels::{Bf16, Level};
use mluc_model::{Manifest, WeightSet};

/// The second frame finds the memory that the first one allocated.
const WARM_UP_FRAMES: usize = 2;

/// The network up to its feature rows, with all memory of a frame.
///
/// [`Backbone::run`] computes a frame and returns its number of rows; [`Backbone::write_rows`] computes the last layers
/// directly into the caller's memory. The bits do not depend on the number of threads of rayon's current pool.
#[derive(Clone, Debug)]
pub struct Backbone(Engine);

#[derive(Clone, Debug)]
enum Engine {
    F32(Box<Layers<f32>>),
    Bf16(Box<Layers<Bf16>>),
    Int8(Box<Layers<u8>>),
    /// The same values and results as `Int8`, for a processor without products of bytes.
    Int8Widened(Box<Layers<i16>>),
}

/// Evaluates the same expression on the layers of any precision.
macro_rules! on_layers {
    ($backbone:expr, $layers:ident => $value:expr) => {
        match $backbone {
            Engine::F32($layers) => $value,
            Engine::Bf16($layers) => $value,
            Engine::Int8($layers) => $value,
            Engine::Int8Widened($layers) => $value,
        }
    };
}

impl Backbone {
    /// Checks the model, packs its weights and computes its response to an empty scene; in f32.
    pub fn new(manifest: &Manifest, weights: &WeightSet) -> Result<Backbone> {
        Backbone::with_precision(manifest, weights, Precision::F32)
    }

    /// [`Backbone::new`] in another precision.
    pub fn with_precision(
        manifest: &Manifest,
        weights: &WeightSet,
        precision: Precision,
    ) -> Result<Backbone> {
        manifest.validate()?;
        weights.check(&manifest.network)?;
        let (precision, _) = precision.chosen(manifest, weights);
        if precision == Precision::Int8 && !weights.is_calibrated() {
            return Err(BackboneError::NotCalibrated);
        }
        let identity = |_: &str, _| Ok(QuantScale::identity());
        let counts = |layer: &str, channels| QuantScale::of_layer(weights, layer, channels);
        Ok(Backbone(match precision {
            Precision::Auto | Precision::F32 => {
                Engine::F32(Box::new(Layers::new(manifest, weights, identity)?))
            }
            Precision::Bf16 => Engine::Bf16(Box::new(Layers::new(manifest, weights, identity)?)),
            Precision::Int8 if Level::best().widens_bytes() => {
                Engine::Int8Widened(Box::new(Layers::new(manifest, weights, counts)?))
            }
            Precision::Int8 => Engine::Int8(Box::new(Layers::new(manifest, weights, counts)?)),
        }))
    }

    /// Runs frames of a synthetic scan, so that the first real frame finds its memory mapped and its code and weights in the
    /// caches. `manifest`: as for [`Backbone::new`]. Discards the last frame.
    pub fn warm_up(&mut self, manifest: &Manifest) -> Result<()> {
        let points = warm_up::scan(manifest);
        for _ in 0..WARM_UP_FRAMES {
            self.run(&points);
            self.last_rows()?;
        }
        self.run(&[]);
        Ok(())
    }

    /// The precision in which the layers multiply.
    pub fn precision(&self) -> Precision {
        match self.0 {
            Engine::F32(_) => Precision::F32,
            Engine::Bf16(_) => Precision::Bf16,
            Engine::Int8(_) | Engine::Int8Widened(_) => Precision::Int8,
        }
    }

    /// Rows (y) and columns (x) of the bird's-eye map.
    pub fn map_shape(&self) -> [usize; 2] {
        on_layers!(&self.0, layers => layers.map_shape())
    }

    /// The last frame's ground, from which the boxes of a network with local input are measured: z at the nodes of a
    /// [`mluc_geometry::ground::GroundGrid`], m; empty for other networks.
    pub fn ground_m(&self) -> &[f32] {
        on_layers!(&self.0, layers => layers.ground_m())
    }

    /// Channels of a feature row.
    pub fn feature_channels(&self) -> usize {
        on_layers!(&self.0, layers => layers.feature_channels)
    }

    fn cells(&self) -> &[u32] {
        on_layers!(&self.0, layers => layers.cells())
    }

    /// Computes a frame. `points`: x, y, z in m in the sensor frame, intensity 0..1, in the sensor's order.
    pub fn run(&mut self, points: &[[f32; 4]]) -> Frame {
        self.watched(points, Coverage::Active, Watch::Nobody)
    }

    /// [`Backbone::run`] that reports when each step is done, for measurements.
    pub fn run_in_steps(&mut self, points: &[[f32; 4]], steps: Steps) -> Frame {
        self.watched(points, Coverage::Active, Watch::Steps(steps))
    }

    /// [`Backbone::run`] that passes every level to `show` and may compute all cells.
    pub fn run_observed(&mut self, points: &[[f32; 4]], over: Coverage, show: Observer) -> Frame {
        self.watched(points, over, Watch::Levels(show, vec![]))
    }

    fn watched(&mut self, points: &[[f32; 4]], coverage: Coverage, mut watch: Watch) -> Frame {
        on_layers!(&mut self.0, layers => layers.run(points, coverage, &mut watch))
    }

    /// Writes the last frame's rows: `cells` (row * columns + column of the map, ascending; one per row) and `rows`
    /// ([`Backbone::feature_channels`] values per cell). A cell without a row equals the response to an empty scene.
    pub fn write_rows(&self, cells: &mut [u32], rows: &mut [f32]) -> Result<()> {
        let found = self.cells();
        for (what, expected, given) in [
            ("cells", found.len(), cells.len()),
            ("values", found.len() * self.feature_channels(), rows.len()),
        ] {
            if expected != given {
                return Err(BackboneError::Room(what, expected, given));
            }
        }
        cells.copy_from_slice(found);
        on_layers!(&self.0, layers => layers.write(rows));
        Ok(())
    }

    /// [`Backbone::write_rows`] into new vectors: cells and rows.
    pub fn last_rows(&self) -> Result<(Vec<u32>, Vec<f32>)> {
        let mut cells = vec![0; self.cells().len()];
        let mut rows = vec![f32::NAN; cells.len() * self.feature_channels()];
        self.write_rows(&mut cells, &mut rows)?;
        Ok((cells, rows))
    }

    /// The response to an empty scene: one feature row for every cell of the map, in order.
    pub fn empty_rows(&mut self) -> Result<Vec<f32>> {
        self.watched(&[], Coverage::Everywhere, Watch::Nobody);
        Ok(self.last_rows()?.1)
    }
}
