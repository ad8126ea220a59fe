//! A set of places in a square grid, a bit for each: a row's part of it is found at once.

/// Cells along a side: whole words.
pub(super) const SIDE: usize = 1024;
const WORD: usize = u64::BITS as usize;

/// The set.
#[derive(Debug)]
pub(super) struct Places {
    words: Vec<u64>,
}

impl Default for Places {
    fn default() -> Places {
        // One more: a part of a row is read from two words.
        Places {
            words: vec![0; SIDE * SIDE / WORD + 1],
        }
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_hold_what_was_inserted_and_not_removed() {
        let mut places = Places::default();
        let last = (SIDE * SIDE - 1) as u32;
        let all = [0, 1, 62, 63, 64, 130, 1023, 1024, last];
        all.iter().for_each(|&place| places.insert(place));
        assert!(places.remove(62) && !places.remove(62));
        for first in (0..1100).chain(last - 70..=last) {
            for count in [1, 7, 31, 63] {
                let is_there = |i: u64| all.contains(&(first + i as u32)) && first + i as u32 != 62;
                let inside = (0..u64::from(count)).filter(|&i| is_there(i));
                let expected: u64 = inside.map(|i| 1 << i).sum();
                assert_eq!(places.part(first, count), expected, "{first}");
            }
        }
    }
}
