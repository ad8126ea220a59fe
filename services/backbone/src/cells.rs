//! A set of cells of a bird's-eye map: the cells whose features can differ from the empty scene's features.

use crate::sites::{even_bits, set_bits};

/// Bits (every map row starts a new word) and the ascending list of the same cells.
#[derive(Clone, Debug, Default)]
pub(crate) struct CellSet {
    /// Rows, columns.
    pub(crate) shape: [usize; 2],
    words_per_row: usize,
    words: Vec<u64>,
    /// row * columns + column, ascending.
    pub(crate) list: Vec<u32>,
    /// One row of another set while it is read.
    scratch: Vec<u64>,
}

impl CellSet {
    /// An empty set on a map of rows (y) x columns (x).
    pub(crate) fn new(shape: [usize; 2]) -> CellSet {
        let words_per_row = shape[1].div_ceil(64);
        let words = vec![0; shape[0] * words_per_row];
        CellSet {
            shape,
            words_per_row,
            words,
            list: Vec::with_capacity(shape[0] * shape[1]),
            // An input map is at most twice as wide.
            scratch: Vec::with_capacity(2 * words_per_row),
        }
    }

    /// Sets the cells, given as (row, column) in any order.
    pub(crate) fn assign(&mut self, cells: impl Iterator<Item = [usize; 2]>) {
        self.words.fill(0);
        for [y, x] in cells {
            self.words[y * self.words_per_row + x / 64] |= 1 << (x % 64);
        }
        self.write_list();
    }

    /// Copies the cells of `other`, on a map of the same shape.
    pub(crate) fn assign_same(&mut self, other: &CellSet) {
        self.words.copy_from_slice(&other.words);
        self.list.clone_from(&other.list);
    }

    pub(crate) fn assign_all(&mut self) {
        let [rows, columns] = self.shape;
        self.assign((0..rows * columns).map(|cell| [cell / columns, cell % columns]));
    }

    /// Sets the cells to the outputs of a 3x3 convolution with padding 1 that read any cell of `input`.
    pub(crate) fn assign_readers(&mut self, input: &CellSet, stride: usize) {
        debug_assert!((1..=2).contains(&stride));
        let words_in = input.words_per_row;
        let mut row = std::mem::take(&mut self.scratch);
        row.resize(words_in, 0);
        for y in 0..self.shape[0] {
            row.fill(0);
            let read = (y * stride).saturating_sub(1)..(y * stride + 2).min(input.shape[0]);
            for word in read.flat_map(|y| input.row(y)).enumerate() {
                row[word.0 % words_in] |= word.1;
            }
            let out = &mut self.words[y * self.words_per_row..][..self.words_per_row];
            for (word, out) in out.iter_mut().enumerate() {
                let even = |word| even_bits(widened(&row, word));
                *out = match stride {
                    1 => widened(&row, word),
                    _ => even(2 * word) | even(2 * word + 1) << 32,
                };
            }
            mask_beyond(out, self.shape[1]);
        }
        self.scratch = row;
        self.write_list();
    }

    /// Sets the cells to the 2x2 patches of `input`'s cells, on a map of twice the size.
    pub(crate) fn assign_doubled(&mut self, input: &CellSet) {
        let columns = input.shape[1];
        let cells = input.list.iter().map(|cell| *cell as usize);
        let corners = cells.map(|cell| [2 * (cell / columns), 2 * (cell % columns)]);
        let patch = |[y, x]: [usize; 2]| [[y, x], [y, x + 1], [y + 1, x], [y + 1, x + 1]];
        self.assign(corners.flat_map(patch));
    }

    /// Calls `visit` with every cell that is in this set and not in `other`, ascending.
    pub(crate) fn for_each_missing(&self, other: &CellSet, mut visit: impl FnMut(usize)) {
        for (number, (here, there)) in self.words.iter().zip(&other.words).enumerate() {
            let first = self.first_cell(number);
            set_bits(here & !there).for_each(|bit| visit(first + bit));
        }
    }

    pub(crate) fn contains(&self, y: usize, x: usize) -> bool {
        self.words[y * self.words_per_row + x / 64] >> (x % 64) & 1 == 1
    }

    fn row(&self, y: usize) -> &[u64] {
        &self.words[y * self.words_per_row..][..self.words_per_row]
    }

    fn write_list(&mut self) {
        let mut list = std::mem::take(&mut self.list);
        list.clear();
        for (number, word) in self.words.iter().enumerate() {
            let first = self.first_cell(number);
            list.extend(set_bits(*word).map(|bit| (first + bit) as u32));
        }
        self.list = list;
    }

    /// The cell of the first bit of the `number`-th word.
    fn first_cell(&self, number: usize) -> usize {
        let (y, word) = (number / self.words_per_row, number % self.words_per_row);
        y * self.shape[1] + word * 64
    }
}

/// A word of `row` in which both neighbours of each bit are also set; 0 beyond the row.
fn widened(row: &[u64], word: usize) -> u64 {
    let at = |word: Option<usize>| word.and_then(|word| row.get(word)).copied().unwrap_or(0);
    let (before, here, after) = (at(word.checked_sub(1)), at(Some(word)), at(Some(word + 1)));
    here | here << 1 | here >> 1 | before >> 63 | after << 63
}

/// Clears the bits of the last word that lie beyond the map.
fn mask_beyond(row: &mut [u64], columns: usize) {
    if let (Some(last), rest @ 1..) = (row.last_mut(), columns % 64) {
        *last &= (1 << rest) - 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_geometry::Random;

    fn random_set(shape: [usize; 2], count: usize, seed: u64) -> CellSet {
        let mut random = Random::from_state(seed);
        let mut set = CellSet::new(shape);
        set.assign((0..count).map(|_| [random.below(shape[0]), random.below(shape[1])]));
        set
    }

    fn has(set: &CellSet, y: i64, x: i64) -> bool {
        let inside = (0..set.shape[0] as i64).contains(&y) && (0..set.shape[1] as i64).contains(&x);
        inside && set.list.contains(&((y * set.shape[1] as i64 + x) as u32))
    }

    #[test]
    fn readers_are_those_of_the_definition() {
        let maps = [[10, 64], [7, 130], [12, 176], [5, 9], [6, 66]];
        for (shape, count) in maps.into_iter().zip([30, 25, 60, 0, 1]) {
            let input = random_set(shape, count, shape[1] as u64);
            for stride in [1, 2] {
                let mut found = CellSet::new(shape.map(|edge| edge.div_ceil(stride)));
                found.assign_readers(&input, stride);
                for y in 0..found.shape[0] as i64 {
                    for x in 0..found.shape[1] as i64 {
                        let (y_in, x_in) = (y * stride as i64, x * stride as i64);
                        let mut window = (0..9).map(|i| (y_in + i / 3 - 1, x_in + i % 3 - 1));
                        let reads = window.any(|(y, x)| has(&input, y, x));
                        assert_eq!(has(&found, y, x), reads, "{shape:?} / {stride} at {y}, {x}");
                    }
                }
                assert!(found.list.is_sorted());
            }
        }
    }
}
