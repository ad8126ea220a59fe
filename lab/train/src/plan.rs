//! The plan of a batch: every layer's gathers, and the positions of sparse rows on the map.

use crate::halo::{self, Cells, Unlisted};
use crate::layers::{LayerPlan, identity};
use mluc_backbone::{Rulebooks, Voxels, localize, voxelize};
use mluc_kernels::{ABSENT, Gather};
use mluc_model::{DenseLayer, Network, VoxelInput};

/// The bird's-eye part of a batch.
#[derive(Clone, Debug, Default)]
pub struct MapPlan {
    /// Frames, rows, columns of the full map.
    pub shape: [usize; 3],
    /// Map row and height level of each row of the last sparse layer.
    pub scatter: Vec<(u32, u32)>,
    /// Cells (over the batch) with a row of the last sparse layer, ascending: rows of the scattered map (it has no
    /// background row: unlisted cells are zero).
    pub occupied: Vec<u32>,
    /// Plans of block 1.
    pub block1: Vec<LayerPlan>,
    /// Plans of block 2.
    pub block2: Vec<LayerPlan>,
    /// The layers without a neighbourhood: on the rows of block 1 and of block 2.
    pub ups: [LayerPlan; 2],
    /// Row of up 1 (a row of block 1) that each cell of the full map reads.
    pub up1_row: Vec<u32>,
    /// Row of up 2 that each cell reads: 4 * (row of block 2) + 2 * (y % 2) + x % 2.
    pub up2_row: Vec<u32>,
}

/// Both parts; the rows of the frames follow one another.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Mean x, y, z, intensity of each voxel.
    pub voxels: Vec<f32>,
    /// The sparse part, layer by layer.
    pub sparse: Vec<LayerPlan>,
    /// The bird's-eye part.
    pub map: MapPlan,
}

impl MapPlan {
    /// The plan from the cells with a voxel. `scatter`: the cell of each sparse row (dense index over the batch) and its level.
    pub fn new(network: &Network, frames: usize, scatter: &[(u32, u32)]) -> MapPlan {
        let [rows, columns] = network.map_shape();
        let mut marks = vec![false; frames * rows * columns];
        let cells = scatter.iter().map(|(cell, _)| *cell as usize);
        cells.for_each(|cell| marks[cell] = true);
        let cells = Cells::from_marks([frames, rows, columns], &marks);
        MapPlan::from_cells(network, cells, scatter)
    }

    /// The plan from the listed cells of the input map.
    pub fn from_cells(network: &Network, input: Cells, scatter: &[(u32, u32)]) -> MapPlan {
        let mut unlisted = Unlisted::Zero;
        let mut cells = input.clone();
        let mut block = |layers: &[DenseLayer], cells: &mut Cells| -> Vec<LayerPlan> {
            let plan = |layer: &DenseLayer| {
                let (plan, output) = halo::convolution(cells, layer.stride, unlisted);
                *cells = output;
                unlisted = Unlisted::Background;
                plan
            };
            layers.iter().map(plan).collect()
        };
        let block1 = block(&network.block1, &mut cells);
        let full = cells.clone();
        let block2 = block(&network.block2, &mut cells);
        let up = |cells: &Cells, copies: usize| LayerPlan {
            gather: identity(cells.rows()),
            transposed: Some(identity(cells.rows())),
            background: None,
            tail: cells.tail(copies),
        };
        let row_of = |(cell, z): &(u32, u32)| (input.row_of[*cell as usize], *z);
        MapPlan {
            shape: full.shape,
            scatter: scatter.iter().map(row_of).collect(),
            block1,
            block2,
            ups: [up(&full, 1), up(&cells, 4)],
            up2_row: up2_rows(full.shape, &cells),
            up1_row: full.row_of,
            occupied: input.listed,
        }
    }

    /// The rows of up 1 and of up 2 that a cell reads.
    pub fn up_rows(&self, cell: usize) -> [usize; 2] {
        [self.up1_row[cell] as usize, self.up2_row[cell] as usize]
    }

    /// Number of cells of the full map over the batch.
    pub fn cells(&self) -> usize {
        self.up1_row.len()
    }
}

fn up2_rows([frames, rows, columns]: [usize; 3], half: &Cells) -> Vec<u32> {
    let [_, half_rows, half_columns] = half.shape;
    let mut rows_of = Vec::with_capacity(frames * rows * columns);
    for frame in 0..frames {
        for y in 0..rows {
            let line = &half.row_of[(frame * half_rows + y / 2) * half_columns..][..half_columns];
            rows_of.extend((0..columns).map(|x| 4 * line[x / 2] + (y % 2 * 2 + x % 2) as u32));
        }
    }
    rows_of
}

/// Builds plans; reuses its memory from batch to batch.
#[derive(Clone, Debug)]
pub struct Planner {
    network: Network,
    voxels: Voxels,
    books: Rulebooks,
}

impl Planner {
    /// A planner for one network.
    pub fn new(network: &Network) -> Planner {
        Planner {
            network: network.clone(),
            voxels: Voxels::new(&network.grid),
            books: Rulebooks::new(network),
        }
    }

    /// The voxels of a scan (x, y, z in m, intensity), in the network's input form.
    pub(crate) fn voxels(&mut self, scan: &[[f32; 4]]) -> &Voxels {
        let grid = &self.network.grid;
        voxelize(scan, grid, false, &mut self.voxels);
        if self.network.input == VoxelInput::Local {
            localize(grid, &mut self.voxels);
        }
        &self.voxels
    }

    /// The plan of a batch of scans (x, y, z in m, intensity).
    pub fn plan(&mut self, scans: &[Vec<[f32; 4]>]) -> Plan {
        let [rows, columns] = self.network.map_shape();
        let taps = self.network.sparse.iter().map(|layer| layer.taps());
        let mut gathers: Vec<Gather> = taps.map(|taps| Gather::new(taps, vec![])).collect();
        let last = gathers.len() - 1;
        // Number of rows of each layer's input, over the frames so far.
        let mut counts = vec![0; gathers.len()];
        let (mut voxels, mut scatter) = (vec![], vec![]);
        for (frame, scan) in scans.iter().enumerate() {
            self.voxels(scan);
            let first = &self.voxels.sites;
            self.books.build(&self.network, first);
            voxels.extend_from_slice(&self.voxels.rows);
            let mut inputs = first.len();
            for (layer, gather) in gathers.iter_mut().enumerate() {
                let offset = counts[layer] as u32;
                let shift = |row: &u32| if *row == ABSENT { ABSENT } else { row + offset };
                let from = self.books.gather(layer);
                gather.index.extend(from.index.iter().map(shift));
                counts[layer] += inputs;
                inputs = self.books.sites_after(layer, first).len();
            }
            let sites = self.books.sites_after(last, first).coordinates();
            scatter.extend(sites.iter().map(|site| {
                let [z, y, x] = site.map(u32::from);
                ((frame as u32 * rows as u32 + y) * columns as u32 + x, z)
            }));
        }
        let layer = |(number, gather): (usize, Gather)| LayerPlan {
            // The first layer's input is data: its gradient is not needed.
            transposed: (number > 0).then(|| gather.transposed(counts[number])),
            gather,
            ..LayerPlan::default()
        };
        Plan {
            voxels,
            sparse: gathers.into_iter().enumerate().map(layer).collect(),
            map: MapPlan::new(&self.network, scans.len(), &scatter),
        }
    }
}
