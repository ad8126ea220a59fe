//! Whole numbers in ascending order without comparing them: a bit for each.

/// Fewer are compared: a bit's way costs more.
const FEW: usize = 64;

/// Sorts again and again; the buffer is reused.
#[derive(Debug, Default)]
pub(crate) struct Ascending {
    /// Of the numbers between the least and the largest, 64 a word.
    words: Vec<u64>,
}

impl Ascending {
    /// Sorts numbers that are there once each. Time and memory grow with the distance from the least to the largest: meant for indices into a scan or a grid.
    pub(crate) fn sort(&mut self, numbers: &mut [u32]) {
        if numbers.len() < FEW {
            return numbers.sort_unstable();
        }
        let span = |(low, high): (u32, u32), n: &u32| (low.min(*n), high.max(*n));
        let (low, high) = numbers.iter().fold((u32::MAX, 0), span);
        let base = low / 64;
        self.words.clear();
        self.words.resize((high / 64 - base) as usize + 1, 0);
        for &number in &*numbers {
            self.words[(number / 64 - base) as usize] |= 1 << (number % 64);
        }
        let mut places = numbers.iter_mut();
        for (at, &word) in self.words.iter().enumerate() {
            let first = (base + at as u32) * 64;
            let mut left = word;
            while left != 0
                && let Some(place) = places.next()
            {
                *place = first + left.trailing_zeros();
                left &= left - 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn numbers_come_out_as_from_comparing_them() {
        let mut ascending = Ascending::default();
        let spread = |count: usize, step: u32| {
            let numbers = (0..count as u32).map(move |i| i.wrapping_mul(2_654_435_761) % 8192);
            numbers.map(move |n| n * step + 131)
        };
        for count in [0, 1, FEW - 1, FEW, 1000, 5000] {
            for step in [1, 7, 26] {
                let expected: BTreeSet<u32> = spread(count, step).collect();
                let mut found: Vec<u32> = expected.iter().rev().copied().collect();
                let half = found.len() / 2;
                found.rotate_left(half);
                ascending.sort(&mut found);
                assert!(found.into_iter().eq(expected));
            }
        }
    }
}
