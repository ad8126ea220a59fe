//! The occupied cells of one resolution ("sites"), sorted by (z, y, x), with a lookup from position to row number.
//!
//! Each cell has a presence bit (every x-row starts a new 64-bit word), and each word has the number of sites before it: a
//! lookup is two loads and a population count. A second bitmap, one bit per word, marks the words in use. Sorting and
//! clearing touch these words alone, so the empty rest of the grid costs nothing.

use mluc_kernels::ABSENT;

/// Sites of one resolution. Fill with [`Sites::insert`], then [`Sites::finish`], then look up; [`Sites::clear`] starts the next frame in the same memory.
#[derive(Clone, Debug, Default)]
pub struct Sites {
    shape: [usize; 3],
    words_per_row: usize,
    /// Presence, x along the bits.
    words: Vec<u64>,
    /// Number of sites before each word in use; stale for other words.
    sites_before: Vec<u32>,
    /// Marks the words in use, one bit per word.
    used: Vec<u64>,
    coordinates: Vec<[u16; 3]>,
    count: usize,
}

impl Sites {
    /// No sites yet on a grid of `shape` (z, y, x).
    ///
    /// Panics if an edge exceeds 65,536 cells; a checked manifest bounds the edges.
    pub fn new(shape: [usize; 3]) -> Sites {
        assert!(shape.iter().all(|edge| *edge <= 1 << 16), "grid {shape:?} is too large");
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

    /// Makes room for `count` sites; inserting more is allowed.
    pub fn reserve(&mut self, count: usize) {
        let more = count.saturating_sub(self.coordinates.len());
        self.coordinates.reserve(more);
    }

    /// z, y, x edges of the grid, cells.
    pub fn shape(&self) -> [usize; 3] {
        self.shape
    }

    /// Number of inserted sites.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether there is no site.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// z, y, x of each site in row order. Valid after [`Sites::finish`].
    pub fn coordinates(&self) -> &[[u16; 3]] {
        &self.coordinates
    }

    /// Removes all sites; the memory is kept.
    pub fn clear(&mut self) {
        for (group, used) in self.used.iter_mut().enumerate() {
            for bit in set_bits(std::mem::take(used)) {
                self.words[group * 64 + bit] = 0;
            }
        }
        self.coordinates.clear();
        self.count = 0;
    }

    /// Address of the bit of a cell of the grid, for the functions below.
    #[inline(always)]
    pub(crate) fn address(&self, z: usize, y: usize, x: usize) -> usize {
        (z * self.shape[1] + y) * self.words_per_row * 64 + x
    }

    /// Whether the cell at an address is a site. Valid at any time.
    pub(crate) fn contains(&self, address: usize) -> bool {
        self.words[address / 64] & (1 << (address % 64)) != 0
    }

    /// Adds the cell at an address; true if it was not a site before.
    pub(crate) fn insert_at(&mut self, address: usize) -> bool {
        let (word, bit) = (address / 64, 1 << (address % 64));
        let present = self.words[word];
        self.words[word] = present | bit;
        self.used[word / 64] |= 1 << (word % 64);
        let fresh = present & bit == 0;
        self.count += usize::from(fresh);
        fresh
    }

    /// Adds a cell of the grid; true if it was not a site before.
    pub fn insert(&mut self, z: usize, y: usize, x: usize) -> bool {
        self.insert_at(self.address(z, y, x))
    }

    /// Adds the cells of an x-row from `x` on whose bits are set; cells beyond the grid are left out.
    pub(crate) fn insert_word(&mut self, z: usize, y: usize, x: usize, bits: u64) {
        let shift = (x % 64) as u32;
        let carried = bits.unbounded_shr(64 - shift);
        let row = (z * self.shape[1] + y) * self.words_per_row;
        for (word, bits) in [(x / 64, bits << shift), (x / 64 + 1, carried)] {
            let cells = self.shape[2].saturating_sub(word * 64).min(64) as u32;
            let bits = bits & !u64::MAX.unbounded_shl(cells);
            if bits == 0 {
                continue;
            }
            let word = row + word;
            let present = self.words[word];
            self.words[word] = present | bits;
            self.used[word / 64] |= 1 << (word % 64);
            self.count += (bits & !present).count_ones() as usize;
        }
    }

    /// The words in use: z, y and the x of the first bit, and the presence of 64 cells. Valid at any time.
    pub(crate) fn words(&self) -> impl Iterator<Item = ([usize; 3], u64)> {
        let used = self.used.iter().enumerate();
        used.flat_map(move |(group, used)| {
            let words = set_bits(*used).map(move |bit| group * 64 + bit);
            words.map(|word| (self.first_of(word), self.words[word]))
        })
    }

    /// z, y, x of a word's first bit.
    fn first_of(&self, word: usize) -> [usize; 3] {
        let (row, first) = (word / self.words_per_row, (word % self.words_per_row) * 64);
        [row / self.shape[1], row % self.shape[1], first]
    }

    /// Numbers the sites in (z, y, x) order.
    pub fn finish(&mut self) {
        self.coordinates.clear();
        for group in 0..self.used.len() {
            for bit in set_bits(self.used[group]) {
                let word = group * 64 + bit;
                self.sites_before[word] = self.coordinates.len() as u32;
                let [z, y, first] = self.first_of(word).map(|v| v as u16);
                let xs = set_bits(self.words[word]).map(|x| first + x as u16);
                self.coordinates.extend(xs.map(|x| [z, y, x]));
            }
        }
    }

    /// Number of sites before the cell at an address; for a site, its row number. Valid for words in use, after [`Sites::finish`].
    #[inline(always)]
    pub(crate) fn index_at(&self, address: usize) -> u32 {
        let (word, bit) = (address / 64, 1 << (address % 64));
        self.sites_before[word] + (self.words[word] & (bit - 1)).count_ones()
    }

    /// Index of the first word of an x-row; `None` outside the grid.
    pub(crate) fn x_row(&self, z: isize, y: isize) -> Option<usize> {
        // As unsigned numbers, negative coordinates are beyond the grid.
        let is_inside = (z as usize) < self.shape[0] && (y as usize) < self.shape[1];
        is_inside.then(|| (z as usize * self.shape[1] + y as usize) * self.words_per_row)
    }

    /// Row numbers of `found.len()` (at most 64) cells of an [`Sites::x_row`] from `x` on; the cells may begin and end outside
    /// the grid. [`ABSENT`] for a cell without a site. Valid after [`Sites::finish`].
    #[inline(always)]
    pub(crate) fn look_along(&self, x_row: Option<usize>, x: isize, found: &mut [u32]) {
        let Some(row) = x_row.filter(|_| x < self.shape[2] as isize) else {
            return found.iter_mut().for_each(|found| *found = ABSENT);
        };
        let skipped = (-x).max(0) as usize;
        let (word, shift) = (row + x.max(0) as usize / 64, x.max(0) as usize % 64);
        let present = self.words[word];
        let mut bits = present >> shift;
        let mut number = self.index_at(word * 64 + shift);
        if shift + found.len() > 64 && word + 1 < row + self.words_per_row {
            bits |= self.words[word + 1] << (64 - shift);
            // The count of an unused word is stale.
            if present == 0 {
                number = self.sites_before[word + 1];
            }
        }
        bits = bits.unbounded_shl(skipped as u32);
        // The sites of an x-row have consecutive numbers, so one count is enough. No branch: the pattern of sites cannot be predicted.
        for found in found {
            let site = (bits & 1) as u32;
            *found = number | site.wrapping_sub(1);
            number = number.wrapping_add(site);
            bits >>= 1;
        }
    }
}

/// Positions of the set bits, lowest first.
pub(crate) fn set_bits(mut word: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let bit = word.trailing_zeros() as usize;
        (word != 0).then(|| {
            word &= word - 1;
            bit
        })
    })
}

/// Bits 0, 2, 4, ... moved together into the low half.
pub(crate) fn even_bits(mut word: u64) -> u64 {
    word &= 0x5555_5555_5555_5555;
    word = (word | word >> 1) & 0x3333_3333_3333_3333;
    word = (word | word >> 2) & 0x0F0F_0F0F_0F0F_0F0F;
    word = (word | word >> 4) & 0x00FF_00FF_00FF_00FF;
    word = (word | word >> 8) & 0x0000_FFFF_0000_FFFF;
    (word | word >> 16) & 0xFFFF_FFFF
}

/// `number | ABSENT` is [`ABSENT`].
const _: () = assert!(ABSENT == u32::MAX);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::random_sites;
    use mluc_geometry::Random;

    #[test]
    fn looking_along_a_row_finds_the_sites_there() {
        let sites = random_sites([2, 3, 130], 300, 9);
        let index_of = |at: [isize; 3]| {
            let row = sites.coordinates().iter().position(|site| site.map(|v| v as isize) == at);
            row.map_or(ABSENT, |row| row as u32)
        };
        for (z, y) in [(0, 0), (1, 2), (-1, 0), (2, 0), (0, 3)] {
            for x in -4..134 {
                for width in [1, 3, 7] {
                    let mut found = vec![7; width];
                    sites.look_along(sites.x_row(z, y), x, &mut found);
                    let expected = (x..).map(|x| index_of([z, y, x])).take(width);
                    assert_eq!(found, expected.collect::<Vec<_>>());
                }
            }
        }
    }

    #[test]
    fn rows_are_sorted_and_found_also_in_reused_memory() {
        let mut sites = Sites::new([5, 17, 131]);
        let mut random = Random::from_state(1);
        for _ in 0..3 {
            sites.clear();
            let mut expected = std::collections::BTreeSet::new();
            for _ in 0..700 {
                let at = [5, 17, 131].map(|edge| random.below(edge));
                assert_eq!(sites.insert(at[0], at[1], at[2]), expected.insert(at));
            }
            sites.finish();
            let found = sites.coordinates().iter().map(|c| c.map(usize::from));
            assert!(found.eq(expected.iter().copied()));
            assert_eq!(sites.len(), expected.len());
            for cell in 0..5 * 17 * 131 {
                let [z, y, x] = [cell / (17 * 131), cell / 131 % 17, cell % 131];
                let address = sites.address(z, y, x);
                let is_site = expected.contains(&[z, y, x]);
                assert_eq!(sites.contains(address), is_site);
                if is_site {
                    let row = expected.range(..[z, y, x]).count();
                    assert_eq!(sites.index_at(address), row as u32);
                }
            }
        }
    }
}
