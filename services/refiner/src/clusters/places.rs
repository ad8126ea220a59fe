//! A set of places in a square grid, one bit per place: a part of a row is read at once.

use smart_default::SmartDefault;

/// Number of cells along a side: a multiple of the word size.
pub(super) const SIDE: usize = 1024;
const WORD: usize = u64::BITS as usize;

#[derive(Debug, SmartDefault)]
pub(super) struct Places {
    /// One word more than are filled, because a part of a row is read from two words.
    #[default(vec![0; SIDE * SIDE / WORD + 1])]
    words: Vec<u64>,
}

impl Places {
    pub(super) fn insert(&mut self, place: u32) {
        self.words[place as usize / WORD] |= 1 << (place as usize % WORD);
    }

    /// Removes a place; returns whether it was in the set.
    pub(super) fn remove(&mut self, place: u32) -> bool {
        let (word, bit) = (place as usize / WORD, 1 << (place as usize % WORD));
        let was_there = self.words[word] & bit != 0;
        self.words[word] &= !bit;
        was_there
    }

    /// Bit i is set if `first + i` is in the set, for i below `count`, at most 63.
    pub(super) fn part(&self, first: u32, count: u32) -> u64 {
        let (word, bit) = (first as usize / WORD, first as usize % WORD);
        // In two steps: a shift by all 64 bits is not allowed.
        let above = self.words[word + 1] << 1 << (WORD - 1 - bit);
        (self.words[word] >> bit | above) & ((1 << count) - 1)
    }
}
