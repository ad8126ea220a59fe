//! A small bitmap font: 5 x 7 dots per letter, capitals only (small letters are shown as capitals).

use std::{array, collections::HashMap, sync::LazyLock};

pub(super) const GLYPH_COLUMNS: usize = 5;
pub(super) const GLYPH_ROWS: usize = 7;

type Glyph = [u8; GLYPH_ROWS];

/// One line per character: the character, and its rows from the top.
static ALPHABET: LazyLock<HashMap<char, Glyph>> = LazyLock::new(|| {
    let add = |bits, dot| bits << 1 | u8::from(dot == '#');
    let bits = |row: &str| row.chars().fold(0, add);
    let glyph = |line: &'static str| {
        let mut signs = line.chars();
        let sign = signs.next()?;
        let mut rows = signs.as_str().split_whitespace().map(bits);
        Some((sign, array::from_fn(|_| rows.next().unwrap_or(0))))
    };
    include_str!("font.txt").lines().filter_map(glyph).collect()
});

/// Rows of a letter from the top; the highest of the five bits is the left dot. A character that the font lacks is a hollow box.
pub(super) fn glyph(letter: char) -> Glyph {
    let known = ALPHABET.get(&letter.to_ascii_uppercase());
    *known.unwrap_or(&ALPHABET[&'\u{25a1}'])
}
