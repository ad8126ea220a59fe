//! The lowest point of every tile.

use super::tiles::{NO_TILE, TILES, tile_of, tile_rows};

/// The value of an empty tile.
const EMPTY: [f32; 3] = [0.0, 0.0, f32::INFINITY];

/// x, y, z (m) of the lowest point of every tile; memory is allocated with the first scan.
#[derive(Clone, Debug, Default)]
pub struct Lowest(Vec<[f32; 3]>);

impl Lowest {
    /// Finds the lowest points among these points (x, y, z, m); points beyond the tiles or not finite are left out.
    pub fn find(&mut self, points: impl Iterator<Item = [f32; 3]>) {
        self.0.clear();
        self.0.resize(TILES, EMPTY);
        for point in points {
            let tile = tile_of(point);
            if tile != NO_TILE {
                let lowest = &mut self.0[tile as usize];
                *lowest = lower_point(*lowest, point);
            }
        }
    }

    /// The lowest point of every tile that a square (centre and half side, m) touches, in the last scan given to [`Lowest::find`].
    pub fn around(&self, center_m: [f64; 2], half_side_m: f64) -> impl Iterator<Item = [f32; 3]> {
        let tiles = tile_rows(center_m, half_side_m).filter_map(|row| self.0.get(row));
        tiles.flatten().copied().filter(|point| point[2] < f32::INFINITY)
    }
}

/// The lower of two points. Ties are decided by x, then y, so that the order of points does not matter.
#[inline]
pub fn lower_point(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    let is_b = b[2] < a[2] || (b[2] == a[2] && (b[0] < a[0] || (b[0] == a[0] && b[1] < a[1])));
    if is_b { b } else { a }
}
