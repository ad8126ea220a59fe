//! The input row that each tap of each output row reads.

/// No input row: the tap contributes zero (padding, or an empty voxel).
pub const ABSENT: u32 = u32::MAX;

/// Row-major table (output row, tap) of input row numbers, or [`ABSENT`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Gather {
    /// Taps of the kernel: 9 for 3x3, 27 for 3x3x3, 1 for 1x1.
    pub taps: usize,
    /// `outputs() * taps` entries.
    pub index: Vec<u32>,
}

impl Gather {
    /// `taps` of the kernel, `index` of each output row and tap.
    pub fn new(taps: usize, index: Vec<u32>) -> Gather {
        Gather { taps, index }
    }

    /// Number of output rows; 0 without taps.
    pub fn outputs(&self) -> usize {
        self.index.len().checked_div(self.taps).unwrap_or(0)
    }

    /// Number of products of an input row with the weights of a tap.
    pub fn products(&self) -> usize {
        self.index.iter().filter(|row| **row != ABSENT).count()
    }

    /// The gather of the input gradient: for each input row and tap, the output row that read it.
    ///
    /// Each (input row, tap) must be read at most once; of several readers the last is kept.
    ///
    /// # Panics
    /// When an input row is not below `inputs`.
    pub fn transposed(&self, inputs: usize) -> Gather {
        let mut index = vec![ABSENT; inputs * self.taps];
        for (output, row) in self.index.chunks_exact(self.taps.max(1)).enumerate() {
            for (tap, &input) in row.iter().enumerate() {
                if input != ABSENT {
                    index[input as usize * self.taps + tap] = output as u32;
                }
            }
        }
        Gather::new(self.taps, index)
    }
}
