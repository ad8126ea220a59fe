//! The occupied cells of one resolution ("sites"), sorted by (z, y, x), with a lookup from position to row number.
//!
//! A presence bit a cell (every x-row starts a fresh 64-bit word), and beside each word the number of sites before it:
//! a lookup is two loads and a population count. A second bitmap, one bit a word, says which words are in use, so that
//! sorting and clearing touch those alone and a frame costs nothing for the empty rest of the grid.

/// Sites of one resolution. Fill with [`Sites::insert`], then [`Sites::finish`], then look up; [`Sites::clear`] starts
/// the next frame in the same memory.
#[derive(Clone, Debug, Default)]
pub struct Sites {
    shape: [usize; 3],
    words_per_row: usize,
    /// Presence, x along the bits.
    words: Vec<u64>,
    /// Sites before each word that is in use; stale elsewhere.
    sites_before: Vec<u32>,
    /// Which words are in use.
    used: Vec<u64>,
    coordinates: Vec<[u16; 3]>,
    count: usize,
}

impl Sites {
    /// No sites yet on a grid of `shape` (z, y, x).
    ///
    /// Panics where an edge exceeds 65,536 cells: a checked manifest bounds them.
    pub fn new(shape: [usize; 3]) -> Sites {
        assert!(
            shape.iter().all(|edge| *edge <= 1 << 16),
            "grid {shape:?} is too large"
        );
        let words_per_row = shape[2].div_ceil(64);
        let words = shape[0] * shape[1] * words_per_row;
        Sites {
            shape,
            words_per_row,
            words: vec![0; words],
            sites_before: vec![0; words],
            used: vec![0; words.div_ceil(64)],
            coordinates: Vec::new(),
            count: 0,
        }
    }

    /// z, y, x edges of the grid, cells.
    pub fn shape(&self) -> [usize; 3] {
        self.shape
    }

    /// Sites inserted.
    pub fn len(&self) -> usize {
        self.count
    }

    /// No site.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// z, y, x of each site in row order. Valid after [`Sites::finish`].
    pub fn coordinates(&self) -> &[[u16; 3]] {
        &self.coordinates
    }

    /// Forgets all sites; the memory stays.
    pub fn clear(&mut self) {
        for (group, used) in self.used.iter_mut().enumerate() {
            for bit in bits(std::mem::take(used)) {
                self.words[group * 64 + bit] = 0;
            }
        }
        self.coordinates.clear();
        self.count = 0;
    }

    /// Whether the cell is a site. Valid at any time.
    pub fn contains(&self, z: usize, y: usize, x: usize) -> bool {
        let word = (z * self.shape[1] + y) * self.words_per_row + x / 64;
        self.words[word] & (1 << (x % 64)) != 0
    }

    /// Adds a cell of the grid; true where it was not there.
    pub fn insert(&mut self, z: usize, y: usize, x: usize) -> bool {
        let word = (z * self.shape[1] + y) * self.words_per_row + x / 64;
        let bit = 1 << (x % 64);
        let fresh = self.words[word] & bit == 0;
        self.words[word] |= bit;
        self.used[word / 64] |= 1 << (word % 64);
        self.count += usize::from(fresh);
        fresh
    }

    /// Numbers the sites in (z, y, x) order.
    pub fn finish(&mut self) {
        self.coordinates.clear();
        for (group, used) in self.used.iter().enumerate() {
            for bit in bits(*used) {
                let word = group * 64 + bit;
                self.sites_before[word] = self.coordinates.len() as u32;
                let (row, first) = (word / self.words_per_row, (word % self.words_per_row) * 64);
                let (z, y) = ((row / self.shape[1]) as u16, (row % self.shape[1]) as u16);
                let xs = bits(self.words[word]);
                self.coordinates
                    .extend(xs.map(|x| [z, y, (first + x) as u16]));
            }
        }
    }

    /// Row number of the site at a cell; none where the cell is empty or off the grid. Valid after [`Sites::finish`].
    pub fn index_of(&self, z: usize, y: usize, x: usize) -> Option<u32> {
        let row = self.row(z as isize, y as isize)?;
        self.index_in_row(row, x as isize)
    }

    /// The x-row at z, y, for [`Sites::index_in_row`]; none off the grid.
    pub(crate) fn row(&self, z: isize, y: isize) -> Option<usize> {
        let inside =
            (0..self.shape[0] as isize).contains(&z) && (0..self.shape[1] as isize).contains(&y);
        inside.then(|| (z as usize * self.shape[1] + y as usize) * self.words_per_row)
    }

    /// Row number of the site at x in an x-row.
    pub(crate) fn index_in_row(&self, row: usize, x: isize) -> Option<u32> {
        if !(0..self.shape[2] as isize).contains(&x) {
            return None;
        }
        let (word, bit) = (row + x as usize / 64, 1 << (x as usize % 64));
        let present = self.words[word];
        (present & bit != 0).then(|| self.sites_before[word] + (present & (bit - 1)).count_ones())
    }
}

/// Positions of the set bits, lowest first.
fn bits(mut word: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let bit = word.trailing_zeros() as usize;
        (word != 0).then(|| {
            word &= word - 1;
            bit
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Random;

    #[test]
    fn rows_are_sorted_and_found_also_in_reused_memory() {
        let mut sites = Sites::new([5, 17, 131]);
        let mut random = Random::new(1);
        for _ in 0..3 {
            sites.clear();
            let mut expected = std::collections::BTreeSet::new();
            for _ in 0..700 {
                let at = [random.below(5), random.below(17), random.below(131)];
                assert_eq!(sites.insert(at[0], at[1], at[2]), expected.insert(at));
            }
            sites.finish();
            let found: Vec<_> = sites
                .coordinates()
                .iter()
                .map(|c| c.map(usize::from))
                .collect();
            assert_eq!(found, expected.iter().copied().collect::<Vec<_>>());
            assert_eq!(sites.len(), expected.len());
            for z in 0..5 {
                for y in 0..17 {
                    for x in 0..131 {
                        let row = expected.iter().position(|at| *at == [z, y, x]);
                        assert_eq!(sites.index_of(z, y, x), row.map(|row| row as u32));
                        assert_eq!(sites.contains(z, y, x), row.is_some());
                    }
                }
            }
        }
        assert_eq!(sites.index_of(5, 0, 0), None);
        assert_eq!(sites.index_of(0, 0, 131), None);
    }
}
