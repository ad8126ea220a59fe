//! What a batch of frames makes of the network: every layer's gathers, and where sparse rows land on the map.

use mluc_backbone::{Rulebooks, Voxels, voxelize};
use mluc_kernels::{ABSENT, Gather};
use mluc_model::Network;

use super::halo::{self, Cells, Step, Unlisted};

/// The sparse part of a batch: frames' rows one after another.
#[derive(Clone, Debug, Default)]
pub struct SparsePlan {
    /// Mean x, y, z, intensity of each voxel.
    pub voxels: Vec<f32>,
    /// Each layer's gather.
    pub gathers: Vec<Gather>,
    /// Each layer's, by input row.
    pub transposed: Vec<Gather>,
}

/// The bird's-eye part of a batch.
#[derive(Clone, Debug)]
pub struct MapPlan {
    /// Frames, rows, columns of the full map.
    pub shape: [usize; 3],
    /// Map row and height level of each row of the last sparse layer.
    pub scatter: Vec<(u32, u32)>,
    /// Cells (over the batch) that hold a row of the last sparse layer, ascending.
    pub occupied: Vec<u32>,
    /// Rows of the scattered map (it has no background row: unlisted cells are zero).
    pub map_rows: usize,
    /// Block 1.
    pub block1: Vec<Step>,
    /// Block 2.
    pub block2: Vec<Step>,
    /// One tap, row by row, for the layers without a neighbourhood: of block 1's rows and of block 2's.
    pub identity: [Gather; 2],
    /// Row of up 1 (block 1's rows) that each cell of the full map reads.
    pub up1_row: Vec<u32>,
    /// Row of up 2 that each cell reads: 4 * (block 2's row) + 2 * (y % 2) + x % 2.
    pub up2_row: Vec<u32>,
}

/// Both parts.
#[derive(Clone, Debug)]
pub struct Plan {
    /// 3-D.
    pub sparse: SparsePlan,
    /// 2-D.
    pub map: MapPlan,
}

/// A gather of `rows` rows onto themselves.
pub fn identity(rows: usize) -> Gather {
    Gather {
        taps: 1,
        index: (0..rows as u32).collect(),
    }
}

impl MapPlan {
    /// From the cells that hold a voxel. `scatter`: the cell of each sparse row (dense index over the batch) and its level.
    pub fn new(network: &Network, frames: usize, scatter: &[(u32, u32)]) -> MapPlan {
        let [rows, columns] = network.map_shape();
        let mut marks = vec![false; frames * rows * columns];
        scatter
            .iter()
            .for_each(|(cell, _)| marks[*cell as usize] = true);
        MapPlan::from_cells(
            network,
            Cells::from_marks([frames, rows, columns], &marks),
            scatter,
        )
    }

    /// From the listed cells of the input map.
    pub fn from_cells(network: &Network, input: Cells, scatter: &[(u32, u32)]) -> MapPlan {
        let mut unlisted = Unlisted::Zero;
        let mut cells = input.clone();
        let mut block = |layers: &[mluc_model::DenseLayer], cells: &mut Cells| -> Vec<Step> {
            layers
                .iter()
                .map(|layer| {
                    let (step, output) = halo::convolution(cells, layer.stride, unlisted);
                    *cells = output;
                    unlisted = Unlisted::Background;
                    step
                })
                .collect()
        };
        let block1 = block(&network.block1, &mut cells);
        let full = cells.clone();
        let block2 = block(&network.block2, &mut cells);
        MapPlan {
            shape: full.shape,
            scatter: scatter
                .iter()
                .map(|(cell, z)| (input.row_of[*cell as usize], *z))
                .collect(),
            map_rows: input.listed.len(),
            occupied: input.listed.clone(),
            block1,
            block2,
            identity: [identity(full.rows()), identity(cells.rows())],
            up2_row: up2_rows(full.shape, &cells),
            up1_row: full.row_of,
        }
    }

    /// Cells of the full map over the batch.
    pub fn cells(&self) -> usize {
        self.up1_row.len()
    }
}

fn up2_rows(shape: [usize; 3], half: &Cells) -> Vec<u32> {
    let [frames, rows, columns] = shape;
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

/// Builds plans; keeps its memory from batch to batch.
#[derive(Clone, Debug)]
pub struct Planner {
    network: Network,
    uses_intensity: bool,
    voxels: Voxels,
    books: Rulebooks,
}

impl Planner {
    /// For one network.
    pub fn new(network: &Network, uses_intensity: bool) -> Planner {
        Planner {
            network: network.clone(),
            uses_intensity,
            voxels: Voxels::new(&network.grid),
            books: Rulebooks::new(network),
        }
    }

    /// The plan of a batch of scans (x, y, z in m, intensity).
    pub fn plan(&mut self, scans: &[Vec<[f32; 4]>]) -> Plan {
        let layers = self.network.sparse.len();
        let [rows, columns] = self.network.map_shape();
        let mut sparse = SparsePlan {
            gathers: self
                .network
                .sparse
                .iter()
                .map(|l| Gather {
                    taps: l.taps(),
                    index: vec![],
                })
                .collect(),
            ..SparsePlan::default()
        };
        let mut counts = vec![0; layers + 1];
        let mut scatter = vec![];
        for (frame, scan) in scans.iter().enumerate() {
            voxelize(
                scan,
                &self.network.grid,
                self.uses_intensity,
                &mut self.voxels,
            );
            self.books.build(&self.network, &self.voxels.sites);
            sparse.voxels.extend_from_slice(&self.voxels.rows);
            let mut inputs = self.voxels.sites.len();
            for layer in 0..layers {
                let (from, to) = (self.books.gather(layer), &mut sparse.gathers[layer].index);
                let offset = counts[layer] as u32;
                to.extend(
                    from.index
                        .iter()
                        .map(|i| if *i == ABSENT { ABSENT } else { i + offset }),
                );
                counts[layer] += inputs;
                inputs = self.books.sites_after(layer, &self.voxels.sites).len();
            }
            counts[layers] += inputs;
            let sites = self.books.sites_after(layers - 1, &self.voxels.sites);
            scatter.extend(sites.coordinates().iter().map(|site| {
                let [z, y, x] = site.map(u32::from);
                ((frame as u32 * rows as u32 + y) * columns as u32 + x, z)
            }));
        }
        // The first layer's input is data: nobody wants its gradient.
        sparse.transposed = sparse
            .gathers
            .iter()
            .zip(&counts)
            .enumerate()
            .map(|(layer, (g, inputs))| {
                if layer == 0 {
                    Gather::default()
                } else {
                    g.transposed(*inputs)
                }
            })
            .collect();
        Plan {
            sparse,
            map: MapPlan::new(&self.network, scans.len(), &scatter),
        }
    }
}
