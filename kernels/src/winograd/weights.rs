//! The weights of a layer, transformed once.

use super::{PLACES, chunk_tiles};
use crate::{
    Weights,
    simd::{LINE, Tiled},
    weights::check,
};

/// Transformed weights of a 3x3 layer, packed. For i16 they are integers: 4 G g G', at most 9 * 127, of weights g rounded
/// as [`Weights::pack`] rounds them.
#[derive(Clone, Debug, PartialEq)]
pub struct WeightsWinograd<I: Tiled = f32>(pub(super) Weights<I>);

impl<I: Tiled> WeightsWinograd<I> {
    /// Transforms and packs `[tap][cin][cout]` of 9 taps, row by row. `None` when the channels do not fill whole registers on every processor
    /// (multiples of 16; for i16 at least 32 input channels), or are too many for a chunk of tiles: multiply such layers directly.
    ///
    /// # Panics
    /// When `plain` has another length (a broken invariant, not data).
    pub fn pack(cin: usize, cout: usize, plain: &[f32]) -> Option<WeightsWinograd<I>> {
        check(plain, [9, cin, cout]);
        let whole = cin.is_multiple_of(LINE) && cout.is_multiple_of(LINE);
        let fits = whole && cin >= I::STEP * LINE;
        if !fits || chunk_tiles(cin) == 0 {
            return None;
        }
        // G g: transforms three values of the kernel into four.
        let three_to_four = |[a, b, c]: [f64; 3]| [a, (a + b + c) / 2.0, (a - b + c) / 2.0, c];
        let pairs = cin * cout;
        let scale = I::scales([9, cin, cout], |[tap, i, o]| plain[tap * pairs + i * cout + o]);
        let mut transformed = vec![0.0; PLACES * pairs];
        for pair in 0..pairs {
            let scale = scale[pair % cout];
            let tap = |y: usize, x: usize| {
                f64::from(I::rounded(plain[(y * 3 + x) * pairs + pair], scale))
            };
            let columns = [0, 1, 2].map(|x| three_to_four([tap(0, x), tap(1, x), tap(2, x)]));
            for y in 0..4 {
                let row = three_to_four([columns[0][y], columns[1][y], columns[2][y]]);
                for (x, value) in row.into_iter().enumerate() {
                    transformed[(y * 4 + x) * pairs + pair] = value as f32 * I::WEIGHT_FACTOR;
                }
            }
        }
        let weight = |[place, i, o]: [usize; 3]| transformed[place * pairs + i * cout + o];
        let mut packed = Weights::scaled([PLACES, cin, cout], vec![1.0; cout], weight);
        packed.scale = scale.iter().map(|one| one / I::WEIGHT_FACTOR).collect();
        Some(WeightsWinograd(packed))
    }
}
