//! Tiles of 1 m seen from above: a square of 256 m around the sensor.

use std::ops::Range;

/// Half the side of the square, m: more than the range of the sensors.
pub const HALF_EXTENT_M: f64 = 128.0;
/// Tiles along a side.
pub const SIDE: usize = 2 * HALF_EXTENT_M as usize;
/// Number of tiles.
pub const TILES: usize = SIDE * SIDE;
/// The tile of a point outside of the square, or not finite.
pub const NO_TILE: u32 = u32::MAX;

/// The tile of x, y, z (m); [`NO_TILE`] outside of the square, and for numbers that are not finite.
#[inline(always)]
pub fn tile_of([x, y, z]: [f32; 3]) -> u32 {
    let x = x + HALF_EXTENT_M as f32;
    let y = y + HALF_EXTENT_M as f32;
    // Comparisons with NaN are false. No short-circuit operators: branches that depend on the data cost more than comparisons.
    let side = 0.0..SIDE as f32;
    let inside = side.contains(&x) & side.contains(&y) & (z.abs() <= f32::MAX);
    if inside { whole(y) * SIDE as u32 + whole(x) } else { NO_TILE }
}

/// The integer part of a number from 0 to 2^23, by operations that the compiler can vectorize: adding 2^23 moves it into the low bits.
#[inline(always)]
pub fn whole(v: f32) -> u32 {
    (v.trunc() + 8_388_608.0).to_bits() & 0x7F_FFFF
}

/// Lowest x and y of a tile, m.
pub fn low_corner_m(tile: usize) -> [f32; 2] {
    [tile % SIDE, tile / SIDE].map(|i| i as f32 - HALF_EXTENT_M as f32)
}

/// The tiles that a square (centre and half side, m) touches, row by row; none when a number is NaN.
pub fn tile_rows(center_m: [f64; 2], half_side_m: f64) -> impl Iterator<Item = Range<usize>> {
    let [columns, rows] = center_m.map(|center| {
        let low = center - half_side_m + HALF_EXTENT_M;
        let high = center + half_side_m + HALF_EXTENT_M;
        // False for NaN as well.
        if low < SIDE as f64 && high >= 0.0 && low <= high {
            low.max(0.0) as usize..(high as usize).min(SIDE - 1) + 1
        } else {
            0..0
        }
    });
    rows.map(move |row| row * SIDE + columns.start..row * SIDE + columns.end)
}
