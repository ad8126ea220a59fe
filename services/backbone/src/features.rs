//! The feature rows: both blocks, upsampled to full size and concatenated (paper section 3.1).
//!
//! A row has up1's channels of the cell, then up2's. A cell has a row if block2's cell that covers it can differ from the
//! empty scene. These are all cells that can differ, because block2's first layer reads every such cell of block1.

use crate::error::{BackboneError, Result};
use crate::plane::{MapRows, PlaneLayer};
use crate::{cells::CellSet, convolution::Convolution, precision::Value, quant_scale::QuantScale};
use mluc_kernels::Gather;
use mluc_model::{Folded, Network, WeightSet};

/// The two transposed layers, and the rows of the current frame.
#[derive(Clone, Debug)]
pub(crate) struct Features<V: Value> {
    up1: Convolution<V>,
    /// One per position in a 2x2 patch.
    up2: Vec<Convolution<V>>,
    /// Cells that have a row.
    pub(crate) cells: CellSet,
    /// Gather of the cells of block1's map.
    gather1: Gather,
    /// A feature row is two kernel rows. These are up1's halves.
    rows1: Vec<u32>,
    /// Gather of the active cells of block2's map.
    gather2: Gather,
    /// The kernel rows of up2's halves, by position.
    rows2: [Vec<u32>; 4],
}

impl<V: Value> Features<V> {
    /// `blocks`: the outputs of the last layers of block1 and block2; feature rows are f32.
    pub(crate) fn new(
        network: &Network,
        weights: &WeightSet,
        blocks: [&MapRows; 2],
    ) -> Result<Features<V>> {
        let folded = |up, block: &MapRows| {
            let folded = Folded::up(weights, up)?;
            let folded = QuantScale::between(&block.scale, &QuantScale::identity(), folded);
            Ok::<_, BackboneError>((folded, block.scale.counts(&block.empty_response)))
        };
        let (up1, reads1) = folded(&network.up1, blocks[0])?;
        let (up2, reads2) = folded(&network.up2, blocks[1])?;
        let shape = network.map_shape();
        let cells = shape[0] * shape[1];
        Ok(Features {
            up1: Convolution::around(&up1, &reads1),
            up2: Convolution::by_tap(&up2, &reads2),
            cells: CellSet::new(shape),
            gather1: Gather::new(1, Vec::with_capacity(cells)),
            rows1: Vec::with_capacity(cells),
            gather2: Gather::new(1, Vec::with_capacity(cells / 4)),
            rows2: [(); 4].map(|()| Vec::with_capacity(cells / 4)),
        })
    }

    /// Decides the rows of this frame from block2's active cells.
    pub(crate) fn place(&mut self, block2_active: &CellSet) {
        self.cells.assign_doubled(block2_active);
        let cells = &self.cells.list;
        self.gather1.index.clone_from(cells);
        self.gather2.index.clone_from(&block2_active.list);
        self.rows1.clear();
        let rows = 0..cells.len() as u32;
        self.rows1.extend(rows.map(|row| 2 * row));
        self.rows2.iter_mut().for_each(Vec::clear);
        let columns = self.cells.shape[1] as u32;
        for (row, cell) in cells.iter().enumerate() {
            let position = cell / columns % 2 * 2 + cell % 2;
            self.rows2[position as usize].push(2 * row as u32 + 1);
        }
    }

    /// Computes the rows into `rows`, one for each of `cells`.
    pub(crate) fn write(&self, block1: &PlaneLayer<V>, block2: &PlaneLayer<V>, rows: &mut [f32]) {
        self.up1.run(&block1.values, &self.gather1, Some(&self.rows1), rows);
        for (up2, to) in self.up2.iter().zip(&self.rows2) {
            up2.run(&block2.values, &self.gather2, Some(to), rows);
        }
    }
}
