//! A 3x3 layer on the bird's-eye map, computed only where its input can differ from the empty scene.
//!
//! Far from any point, a layer's output is its response to an empty scene: constant, except near the border, where it depends on the zero padding.
//! This response is computed once. In a frame, a layer computes the cells that read a computed cell of its input; neighbours outside have the stored
//! response. The result equals the dense result: bit for bit, in f32 by tiles up to rounding. After `halo_layers` layers no further cells are added.

use crate::convolution::{Convolution, response};
use crate::{cells::CellSet, error::Result, precision::Value, quant_scale::QuantScale};
use mluc_kernels::{ABSENT, Gather, Level, Tiled};
use mluc_kernels::{WeightsWinograd, WinogradTiles, convolve_winograd};
use mluc_model::{DenseLayer, Folded, WeightSet};
use rayon::prelude::*;

/// The cells of the bird's-eye layers that are computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coverage {
    /// The cells that can differ from the empty scene, as far as the network's halo reaches.
    Active,
    /// All cells: slower; the same result if the halo is unlimited. For tests and for the stored responses.
    Everywhere,
}

/// Number of cells that one task looks up.
const CELLS_A_TASK: usize = 2048;

/// Shape, scale and empty response of a map's rows.
#[derive(Clone, Debug)]
pub(crate) struct MapRows {
    pub(crate) shape: [usize; 2],
    pub(crate) scale: QuantScale,
    /// The row of an empty scene far from the border, as exact numbers.
    pub(crate) empty_response: Vec<f32>,
}

/// One layer with its output map.
#[derive(Clone, Debug)]
pub(crate) struct PlaneLayer<V: Value> {
    pub(crate) name: String,
    pub(crate) output: MapRows,
    /// One row per cell; rows outside `active` have the empty scene's values.
    pub(crate) values: Vec<V>,
    /// Cells that may differ from the empty scene.
    pub(crate) active: CellSet,
    convolution: Convolution<V>,
    stride: usize,
    /// Whether the layer also computes the cells around the cells of its input.
    has_halo: bool,
    input_shape: [usize; 2],
    /// Whether inactive cells of the input are zero, so that their taps need not be computed.
    input_zero_elsewhere: bool,
    /// The response to an empty scene.
    pub(crate) empty: Vec<V>,
    previous: CellSet,
    gather: Gather,
    by_tiles: Option<ByTiles<V::Tiled>>,
}

/// Tiles of a layer of stride 1 in f32 or i16: a tile of 2x2 cells takes 16 products, its 4 windows would take 36.
#[derive(Clone, Debug)]
struct ByTiles<I: Tiled> {
    weights: WeightsWinograd<I>,
    tiles: WinogradTiles,
}

impl<V: Value> PlaneLayer<V> {
    /// `input`: the rows that it reads; `scale`: of its own values. `reads_sparse_map`: its input is zero where no site lies; without the zeros the
    /// direct sum takes fewer products than tiles. `has_halo`: it computes every cell that reads a cell of its input, not only the input's cells.
    pub(crate) fn new(
        layer: &DenseLayer,
        weights: &WeightSet,
        input: &MapRows,
        scale: QuantScale,
        reads_sparse_map: bool,
        has_halo: bool,
    ) -> Result<PlaneLayer<V>> {
        let folded = Folded::dense(weights, layer)?;
        let empty_response = response(&folded, &input.empty_response);
        let folded = QuantScale::between(&input.scale, &scale, folded);
        let shape = input.shape.map(|edge| edge.div_ceil(layer.stride));
        let cells = shape[0] * shape[1];
        let values = vec![V::default(); cells * layer.cout];
        let by_tiles = layer.stride == 1 && !reads_sparse_map && V::tiled(&[], &mut []).is_some();
        let by_tiles = by_tiles
            .then(|| WeightsWinograd::pack(folded.cin, folded.cout, &folded.weights))
            .flatten()
            .map(|weights| ByTiles { weights, tiles: WinogradTiles::new(shape) });
        let taps = if by_tiles.is_some() { 0 } else { cells * 9 };
        let reads = input.scale.counts(&input.empty_response);
        Ok(PlaneLayer {
            name: layer.name.clone(),
            convolution: Convolution::around(&folded, &reads),
            output: MapRows { shape, scale, empty_response },
            stride: layer.stride,
            has_halo,
            input_shape: input.shape,
            input_zero_elsewhere: reads_sparse_map,
            empty: values.clone(),
            values,
            active: CellSet::new(shape),
            previous: CellSet::new(shape),
            gather: Gather::new(9, Vec::with_capacity(taps)),
            by_tiles,
        })
    }

    /// Computes this layer from the map before it, in which only the cells `input_active` may differ from the empty scene.
    pub(crate) fn run(&mut self, input: &[V], input_active: &CellSet, coverage: Coverage) {
        std::mem::swap(&mut self.active, &mut self.previous);
        match coverage {
            Coverage::Active if self.has_halo => {
                self.active.assign_readers(input_active, self.stride);
            }
            Coverage::Active => self.active.assign_same(input_active),
            Coverage::Everywhere => self.active.assign_all(),
        }
        let channels = self.convolution.cout();
        self.previous.for_each_missing(&self.active, |cell| {
            let row = cell * channels..(cell + 1) * channels;
            self.values[row.clone()].copy_from_slice(&self.empty[row]);
        });
        if self.run_by_tiles(input).is_some() {
            return;
        }
        let read = self.input_zero_elsewhere.then_some(input_active);
        let (active, gather) = (&self.active, &mut self.gather);
        window_gather(active, self.input_shape, self.stride, read, gather);
        let output_rows = Some(&active.list[..]);
        self.convolution.run(input, gather, output_rows, &mut self.values);
    }

    /// Computes the active cells by tiles; `None` if this layer cannot.
    fn run_by_tiles(&mut self, input: &[V]) -> Option<()> {
        let ByTiles { weights, tiles } = self.by_tiles.as_mut()?;
        let (input, output) = V::tiled(input, &mut self.values)?;
        tiles.assign(&self.active.list, self.active.shape);
        let (level, epilogue) = (Level::best(), self.convolution.epilogue());
        convolve_winograd(level, input, tiles, weights, epilogue, output);
        Some(())
    }

    /// Products of the last frame: by definition (all cells but those at the border read nine), and as multiplied.
    pub(crate) fn products(&self) -> [usize; 2] {
        match &self.by_tiles {
            Some(by_tiles) => [9 * self.active.list.len(), by_tiles.tiles.products()],
            None => [self.gather.products(); 2],
        }
    }

    pub(crate) fn channels(&self) -> usize {
        self.convolution.cout()
    }
}

/// 3x3 windows (padding 1) around the `active` output cells: the input cell that each tap reads. `read`: the only cells that have to be read.
fn window_gather(
    active: &CellSet,
    input_shape: [usize; 2],
    stride: usize,
    read: Option<&CellSet>,
    gather: &mut Gather,
) {
    let [_, columns] = active.shape;
    gather.index.resize(active.list.len() * 9, ABSENT);
    let tasks = gather.index.par_chunks_mut(CELLS_A_TASK * 9);
    let tasks = tasks.zip(active.list.par_chunks(CELLS_A_TASK));
    tasks.for_each(|(index, cells)| {
        for (taps, cell) in index.chunks_exact_mut(9).zip(cells) {
            let cell = *cell as usize;
            let center = [cell / columns * stride, cell % columns * stride];
            window(center, input_shape, read, taps);
        }
    });
}

fn window([y, x]: [usize; 2], [rows, width]: [usize; 2], read: Option<&CellSet>, taps: &mut [u32]) {
    let inner = y > 0 && y + 1 < rows && x > 0 && x + 1 < width;
    for (number, tap) in taps.iter_mut().enumerate() {
        // One more than the coordinates, so that they do not go below 0.
        let (y, x) = (y + number / 3, x + number % 3);
        let inside = inner || ((1..=rows).contains(&y) && (1..=width).contains(&x));
        let worth = inside && read.is_none_or(|cells| cells.contains(y - 1, x - 1));
        let cell = worth.then(|| ((y - 1) * width + x - 1) as u32);
        *tap = cell.unwrap_or(ABSENT);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_read_their_neighbours_and_nothing_beyond_the_border() {
        let mut cells = CellSet::new([2, 3]);
        cells.assign([[0, 0], [1, 2]].into_iter());
        let mut gather = Gather::new(9, vec![]);
        window_gather(&cells, [2, 3], 1, None, &mut gather);
        let o = ABSENT;
        assert_eq!(gather.index[..9], [o, o, o, o, 0, 1, o, 3, 4]);
        assert_eq!(gather.index[9..], [1, 2, o, 4, 5, o, o, o, o]);
        window_gather(&cells, [2, 3], 1, Some(&cells), &mut gather);
        let present = gather.index.iter().filter(|cell| **cell != ABSENT);
        // Neither of the two cells reads the other.
        assert!(present.eq(&[0, 5]));
        window_gather(&cells, [4, 6], 2, None, &mut gather);
        assert_eq!(gather.index[9..], [9, 10, 11, 15, 16, 17, 21, 22, 23]);
    }
}
