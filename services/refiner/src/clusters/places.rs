//! A set of places in a square grid, a bit for each: a row's part of it is found at once.

use smart_default::SmartDefault;

/// Cells along a side: whole words.
pub(super) const SIDE: usize = 1024;
const WORD: usize = u64::BITS as usize;

#[derive(Debug, SmartDefault)]
pub(super) struct Places {
    /// One more than are filled: a part of a row is read from two words.
    #[default(vec![0; SIDE * SIDE / WORD + 1])]
    words: Vec<u64>,
}

impl Places {
    pub(super) fn insert(&mut self, place: u32) {
        self.words[place as usize / WORD] |= 1 << (place as usize % WORD);
    }

    /// Whether it was there.
    pub(super) fn remove(&mut self, place: u32) -> bool {
        let (word, bit) = (place as usize / WORD, 1 << (place as usize % WORD));
        let was_there = self.words[word] & bit != 0;
        self.words[word] &= !bit;
        was_there
    }

    /// Bit i: whether `first + i` is there, for i below `count`, at most 63.
    pub(super) fn part(&self, first: u32, count: u32) -> u64 {
        let (word, bit) = (first as usize / WORD, first as usize % WORD);
        // In two steps: all 64 at once is no shift.
        let above = self.words[word + 1] << 1 << (WORD - 1 - bit);
        (self.words[word] >> bit | above) & ((1 << count) - 1)
    }
}
