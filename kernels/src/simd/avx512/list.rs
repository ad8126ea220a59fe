//! Lists present rows with AVX-512: sixteen rows of indices are transposed into sixteen taps, and the present entries of each tap are compressed.

use super::Avx512;
use crate::simd::list::{GROUP, Lists};
use std::arch::x86_64::*;

/// As [`crate::simd::Simd::list`]. The first argument proves that the processor has the registers.
#[inline(always)]
pub(super) fn list<const BF16: bool, const VNNI: bool>(
    _: Avx512<BF16, VNNI>,
    lists: &mut Lists,
    first: usize,
) {
    let (index, taps, rows) = (lists.index, lists.taps, lists.rows);
    let width = (taps - first).min(GROUP);
    lists.counts = [0; GROUP];
    // SAFETY: the first argument is the proof of the features. Loads: `columns` reads rows below `rows` only, and `width`
    // taps of each row from `first` on. Stores: a store writes 8 pairs. Before it, a tap has at most as many pairs as
    // rows came before, so at most 96 - 8, and there is room for 8 pairs beyond 96.
    unsafe {
        let (absent, one) = (_mm512_set1_epi32(-1), _mm512_set1_epi32(1));
        let low = _mm512_setr_epi32(0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23);
        let high = _mm512_add_epi32(low, _mm512_set1_epi32(8));
        let mut numbers = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
        let mut inputs = _mm512_setzero_si512();
        for base in (0..rows).step_by(16) {
            let columns = columns(index, taps, first, base, width);
            for tap in 0..width {
                let column = columns[tap];
                // Largest entry + 1; ABSENT + 1 is 0.
                inputs = _mm512_max_epu32(inputs, _mm512_add_epi32(column, one));
                let present = _mm512_cmpneq_epi32_mask(column, absent);
                let to = lists.pairs[tap].as_mut_ptr();
                for (half, order) in [(present as u8, low), ((present >> 8) as u8, high)] {
                    let pairs = _mm512_permutex2var_epi32(column, order, numbers);
                    let kept = _mm512_maskz_compress_epi64(half, pairs);
                    _mm512_storeu_si512(to.add(lists.counts[tap]).cast(), kept);
                    lists.counts[tap] += half.count_ones() as usize;
                }
            }
            numbers = _mm512_add_epi32(numbers, _mm512_set1_epi32(16));
        }
        lists.inputs = _mm512_reduce_max_epu32(inputs) as usize;
    }
}

/// `width` (at most 16) taps of sixteen rows from `base` on, one register per tap; absent beyond the rows.
///
/// # Safety
/// The processor has AVX-512; `index` consists of whole rows of `taps` entries, and `taps` is at least `first + width`.
#[inline(always)]
unsafe fn columns(
    index: &[u32],
    taps: usize,
    first: usize,
    base: usize,
    width: usize,
) -> [__m512i; 16] {
    // SAFETY: the masked loads read the given taps of existing rows only; the caller guarantees the rest.
    unsafe {
        let absent = _mm512_set1_epi32(-1);
        let rows = (index.len() / taps - base).min(16);
        let mut columns = [absent; 16];
        let from = index.as_ptr().add(base * taps + first).cast::<i32>();
        if taps == 1 {
            columns[0] = _mm512_mask_loadu_epi32(absent, lowest(rows), from);
            return columns;
        }
        for (row, column) in columns.iter_mut().enumerate().take(rows) {
            *column = _mm512_mask_loadu_epi32(absent, lowest(width), from.add(row * taps));
        }
        transposed(columns)
    }
}

/// The lowest `count` (at most 16) lanes.
#[inline(always)]
fn lowest(count: usize) -> __mmask16 {
    ((1_u32 << count) - 1) as __mmask16
}

/// Lane `i` of register `j` becomes lane `j` of register `i`.
///
/// # Safety
/// The processor has AVX-512.
#[inline(always)]
unsafe fn transposed(rows: [__m512i; 16]) -> [__m512i; 16] {
    // SAFETY: the caller guarantees the features.
    unsafe {
        let mut fours = rows;
        // Register 4 g + k has, in lane group L, column 4 L + k of the four rows from 4 g on.
        for g in 0..4 {
            let [a, b, c, d] = [0, 1, 2, 3].map(|row| rows[4 * g + row]);
            let (ab_low, ab_high) = (_mm512_unpacklo_epi32(a, b), _mm512_unpackhi_epi32(a, b));
            let (cd_low, cd_high) = (_mm512_unpacklo_epi32(c, d), _mm512_unpackhi_epi32(c, d));
            fours[4 * g] = _mm512_unpacklo_epi64(ab_low, cd_low);
            fours[4 * g + 1] = _mm512_unpackhi_epi64(ab_low, cd_low);
            fours[4 * g + 2] = _mm512_unpacklo_epi64(ab_high, cd_high);
            fours[4 * g + 3] = _mm512_unpackhi_epi64(ab_high, cd_high);
        }
        let mut columns = rows;
        for k in 0..4 {
            let [a, b, c, d] = [0, 1, 2, 3].map(|g| fours[4 * g + k]);
            let ab_low = _mm512_shuffle_i32x4::<0x44>(a, b);
            let ab_high = _mm512_shuffle_i32x4::<0xEE>(a, b);
            let cd_low = _mm512_shuffle_i32x4::<0x44>(c, d);
            let cd_high = _mm512_shuffle_i32x4::<0xEE>(c, d);
            columns[k] = _mm512_shuffle_i32x4::<0x88>(ab_low, cd_low);
            columns[4 + k] = _mm512_shuffle_i32x4::<0xDD>(ab_low, cd_low);
            columns[8 + k] = _mm512_shuffle_i32x4::<0x88>(ab_high, cd_high);
            columns[12 + k] = _mm512_shuffle_i32x4::<0xDD>(ab_high, cd_high);
        }
        columns
    }
}
