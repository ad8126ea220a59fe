//! Which cells of a bird's-eye map need their own row: the halo.
//!
//! Most cells of the map see no voxel through the few convolutions before them. Away from the map's border all such cells
//! have the same vector, so one **background row** represents all of them, with its multiplicity. A cell is
//! **listed** (has its own row) when one of its taps reads a listed cell or padding. This is exact: every cell that could
//! differ is listed. Rows of a map: the listed cells in order (frame, y, x), then the background row.

use crate::{layers::LayerPlan, norm::Tail};
use mluc_kernels::{ABSENT, Gather};

/// The listed cells of a batch of maps.
#[derive(Clone, Debug)]
pub struct Cells {
    /// Frames, rows (y), columns (x).
    pub shape: [usize; 3],
    /// Row of each cell of the dense map; for an unlisted cell the background row [`Cells::background`].
    pub row_of: Vec<u32>,
    /// Dense index of each listed cell, ascending.
    pub listed: Vec<u32>,
}

impl Cells {
    /// The cells that are marked in a dense map.
    pub fn from_marks(shape: [usize; 3], marks: &[bool]) -> Cells {
        let listed = (0..marks.len() as u32).filter(|cell| marks[*cell as usize]);
        let listed: Vec<u32> = listed.collect();
        let mut row_of = vec![listed.len() as u32; marks.len()];
        for (row, &cell) in listed.iter().enumerate() {
            row_of[cell as usize] = row as u32;
        }
        Cells { shape, row_of, listed }
    }

    /// The row that represents every unlisted cell.
    pub fn background(&self) -> u32 {
        self.listed.len() as u32
    }

    /// Number of listed cells plus the background.
    pub fn rows(&self) -> usize {
        self.listed.len() + 1
    }

    /// The background as this number of rows.
    pub fn tail(&self, rows: usize) -> Tail {
        let multiplicity = self.row_of.len() - self.listed.len();
        Tail { rows, multiplicity }
    }

    /// Frame, y and x of a cell.
    fn place(&self, cell: u32) -> (usize, usize, usize) {
        let ([_, rows, columns], cell) = (self.shape, cell as usize);
        let (line, x) = (cell / columns, cell % columns);
        (line / rows, line % rows, x)
    }
}

/// Values of the unlisted cells in a convolution's input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unlisted {
    /// Zero, like padding: the scattered sparse map. There is no background row to read.
    Zero,
    /// The background row.
    Background,
}

/// Plans one 3x3 convolution (padding 1) over listed cells: the rows that it reads, and its output's cells.
pub fn convolution(input: &Cells, stride: usize, unlisted: Unlisted) -> (LayerPlan, Cells) {
    let output = output_cells(input, stride, unlisted);
    let [_, rows, columns] = input.shape;
    let background = (unlisted == Unlisted::Background).then(|| input.background());
    let mut index = Vec::with_capacity(output.rows() * 9);
    for &cell in &output.listed {
        let (frame, y, x) = output.place(cell);
        for tap in 0..9 {
            let (ty, tx) = (y * stride + tap / 3, x * stride + tap % 3);
            // With padding 1, tap coordinates are one too large.
            if ty == 0 || tx == 0 || ty > rows || tx > columns {
                index.push(ABSENT);
                continue;
            }
            let row = input.row_of[(frame * rows + ty - 1) * columns + tx - 1];
            let absent = background.is_none() && row == input.background();
            index.push(if absent { ABSENT } else { row });
        }
    }
    index.extend([background.unwrap_or(ABSENT); 9]);
    let gather = Gather { taps: 9, index };
    let mut transposed = gather.transposed(input.rows());
    transposed.index.truncate(input.listed.len() * 9);
    let plan = LayerPlan { gather, transposed: Some(transposed), background, tail: output.tail(1) };
    (plan, output)
}

/// Every cell with a tap on a listed cell, or on padding where padding differs from the background.
fn output_cells(input: &Cells, stride: usize, unlisted: Unlisted) -> Cells {
    let [frames, rows, columns] = input.shape;
    let [out_rows, out_columns] = [rows, columns].map(|size| (size - 1) / stride + 1);
    let shape = [frames, out_rows, out_columns];
    let mut marks = vec![false; frames * out_rows * out_columns];
    // Output (y, x) reads inputs y * stride - 1 ..= y * stride + 1: those y with |y * stride - input| <= 1.
    let readers = |at: usize, limit: usize| {
        let first = at.saturating_sub(1).div_ceil(stride);
        (first, ((at + 1) / stride).min(limit - 1))
    };
    for &cell in &input.listed {
        let (frame, y, x) = input.place(cell);
        let ((y0, y1), (x0, x1)) = (readers(y, out_rows), readers(x, out_columns));
        for oy in y0..=y1 {
            let start = (frame * out_rows + oy) * out_columns;
            if x0 <= x1 {
                marks[start + x0..=start + x1].fill(true);
            }
        }
    }
    if unlisted == Unlisted::Background {
        let on_padding = |at: usize, limit: usize| at == 0 || at * stride + 1 >= limit;
        for (number, line) in marks.chunks_exact_mut(out_columns).enumerate() {
            let whole_line = on_padding(number % out_rows, rows);
            for (x, mark) in line.iter_mut().enumerate() {
                *mark |= whole_line || on_padding(x, columns);
            }
        }
    }
    Cells::from_marks(shape, &marks)
}
