//! The lowest point of every tile.

use super::tiles::{NO_TILE, TILES, tile_of, tile_rows};

/// For [`Lowest::common_z_m`]: bins from here up, their width, how many, and the fewest tiles that say something.
const BINS_LOW_M: f32 = -6.0;
const BIN_M: f32 = 0.25;
const BINS: usize = 28;
const TILES_MIN: u32 = 12;

/// In an empty tile.
const EMPTY: [f32; 3] = [0.0, 0.0, f32::INFINITY];

/// x, y, z (m) of the lowest point of every tile.
#[derive(Clone, Debug)]
pub struct Lowest(Vec<[f32; 3]>);

impl Default for Lowest {
    fn default() -> Lowest {
        Lowest(vec![EMPTY; TILES])
    }
}

impl Lowest {
    /// No points.
    pub fn clear(&mut self) {
        self.0.fill(EMPTY);
    }

    /// Takes points (x, y, z, m) into account; those beyond the tiles or not finite have no say.
    pub fn add(&mut self, points: impl Iterator<Item = [f32; 3]>) {
        for point in points {
            let tile = tile_of(point);
            if tile != NO_TILE {
                self.lower(tile as usize, point);
            }
        }
    }

    /// A point of a tile. Ties go by x and y, so that the order of points does not matter.
    #[inline]
    pub fn lower(&mut self, tile: usize, [x, y, z]: [f32; 3]) {
        let [bx, by, bz] = self.0[tile];
        if z < bz || (z == bz && (x < bx || (x == bx && y < by))) {
            self.0[tile] = [x, y, z];
        }
    }

    /// z of the ground around the sensor, m: what most tiles within 20 m have in common; `None` where there are few.
    pub fn common_z_m(&self) -> Option<f64> {
        let mut counts = [0u32; BINS];
        for [_, _, z] in self.around([0.0; 2], 20.0) {
            let bin = (z - BINS_LOW_M) / BIN_M;
            if (0.0..BINS as f32).contains(&bin) {
                counts[bin as usize] += 1;
            }
        }
        // Neighbours count with it: the ground slopes.
        let pairs = counts.windows(2).map(|pair| pair[0] + pair[1]);
        let (bin, count) = pairs
            .enumerate()
            .max_by_key(|&(bin, count)| (count, BINS - bin))?;
        let z = BINS_LOW_M + (bin + 1) as f32 * BIN_M;
        (count >= TILES_MIN).then_some(f64::from(z))
    }

    /// The lowest point of every tile that a square touches.
    pub fn around(&self, center_m: [f64; 2], half_side_m: f64) -> impl Iterator<Item = [f32; 3]> {
        let tiles = tile_rows(center_m, half_side_m).flat_map(|row| &self.0[row]);
        tiles.copied().filter(|point| point[2] < f32::INFINITY)
    }
}
