//! The weights of a layer, transformed once.

use super::{PLACES, chunk_tiles};
use crate::{Weights, simd::LINE, weights::check};

/// Transformed weights of a 3x3 layer, packed.
#[derive(Clone, Debug, PartialEq)]
pub struct WeightsWinograd(pub(super) Weights);

impl WeightsWinograd {
    /// Transforms and packs `[tap][cin][cout]` of 9 taps, row by row. `None` where the channels are not whole registers
    /// of any processor (multiples of 16), or too many for a chunk of tiles: multiply those directly.
    ///
    /// # Panics
    /// When `plain` has another length (a broken invariant, not data).
    pub fn pack(cin: usize, cout: usize, plain: &[f32]) -> Option<WeightsWinograd> {
        check(plain, [9, cin, cout]);
        let fits = cin > 0 && cin.is_multiple_of(LINE) && cout.is_multiple_of(LINE);
        if !fits || chunk_tiles(cin) == 0 {
            return None;
        }
        // G g: what a row of the kernel gives at each of four places.
        let three_to_four = |[a, b, c]: [f64; 3]| [a, (a + b + c) / 2.0, (a - b + c) / 2.0, c];
        let pairs = cin * cout;
        let mut transformed = vec![0.0; PLACES * pairs];
        for pair in 0..pairs {
            let tap = |y: usize, x: usize| f64::from(plain[(y * 3 + x) * pairs + pair]);
            let columns = [0, 1, 2].map(|x| three_to_four([tap(0, x), tap(1, x), tap(2, x)]));
            for y in 0..4 {
                let row = three_to_four([columns[0][y], columns[1][y], columns[2][y]]);
                for (x, value) in row.into_iter().enumerate() {
                    transformed[(y * 4 + x) * pairs + pair] = value as f32;
                }
            }
        }
        let packed = Weights::pack(PLACES, cin, cout, &transformed);
        Some(WeightsWinograd(packed))
    }
}
