//! The height of the ground on a grid: what the network's input and boxes are measured from.
//!
//! A surface under the lowest points of the tiles, by robust least squares: a plane first, then what lies off it, held together by a membrane between
//! the nodes. Points above the surface soon have no say (things that stand on it), those below keep theirs. Where a scan says nothing, the surface goes
//! on as the plane does.

use super::Lowest;
use nalgebra::{Matrix3, Vector3};

/// Between nodes, m.
const SPACING_M: f32 = 4.0;
/// From the sensor to the outermost nodes along x and y, m.
const HALF_M: f32 = 56.0;
/// Nodes along a side.
const SIDE: usize = (2.0 * HALF_M / SPACING_M) as usize + 1;
/// Nodes of the grid.
pub const GROUND_NODES: usize = SIDE * SIDE;

/// Points farther above the surface than about this have no say; it shrinks from pass to pass, m.
const ABOVE_M: [f64; 7] = [0.6, 0.45, 0.3, 0.2, 0.15, 0.12, 0.12];
/// Below the surface they have it so many times longer.
const BELOW: f64 = 4.0;
/// The plane is fitted to tiles nearer than this, m.
const PLANE_RADIUS_M: f64 = 30.0;
/// What the plane's slopes cost, in tiles at 1 m: without points it lies flat.
const SLOPE_COST: f64 = 2000.0;
/// What a difference between neighbouring nodes costs, and one from the plane, in tiles.
const MEMBRANE: f64 = 1.0;
const TO_PLANE: f64 = 0.01;
/// Sweeps over the nodes in a pass.
const SWEEPS: usize = 12;

/// A tile's lowest point among the nodes around it.
#[derive(Clone, Copy, Debug)]
struct Tile {
    at: [f64; 3],
    /// The node towards -x and -y.
    node: usize,
    /// Shares of that node, its neighbours towards +x and +y, and the fourth.
    shares: [f64; 4],
}

/// Steps in the grid to the nodes of [`Tile::shares`].
const CORNERS: [usize; 4] = [0, 1, SIDE, SIDE + 1];

/// A node's row of the normal equations: itself, and the eight around it.
#[derive(Clone, Copy, Debug, Default)]
struct Row {
    own: f64,
    /// (dy + 1) * 3 + dx + 1.
    around: [f64; 9],
    right: f64,
}

/// Finds the ground of scan after scan; all memory is made once.
#[derive(Clone, Debug)]
pub struct GroundGrid {
    lowest: Lowest,
    tiles: Vec<Tile>,
    rows: Vec<Row>,
    /// Off the plane, m.
    off_m: Vec<f64>,
    heights_m: Vec<f32>,
    sensor_height_m: f64,
}

impl GroundGrid {
    /// `sensor_height_m`: where a scan tells nothing, the ground is so far below the sensor.
    pub fn new(sensor_height_m: f64) -> GroundGrid {
        GroundGrid {
            lowest: Lowest::default(),
            tiles: Vec::with_capacity((4.0 * HALF_M * HALF_M) as usize),
            rows: vec![Row::default(); GROUND_NODES],
            off_m: vec![0.0; GROUND_NODES],
            heights_m: vec![-sensor_height_m as f32; GROUND_NODES],
            sensor_height_m,
        }
    }

    /// The ground of a scan (x, y, z first, m): z at every node, [`GROUND_NODES`] of them, row by row along x; for
    /// [`ground_height_m`].
    pub fn find(&mut self, points: &[[f32; 4]]) -> &[f32] {
        self.lowest.clear();
        self.lowest
            .add(points.iter().map(|&[x, y, z, _]| [x, y, z]));
        self.tiles.clear();
        let reach = f64::from(HALF_M);
        let tiles = self.lowest.around([0.0; 2], reach).filter_map(tile);
        self.tiles.extend(tiles);
        let start = self.lowest.common_z_m().unwrap_or(-self.sensor_height_m);
        let plane = plane(&self.tiles, start);
        for tile in &mut self.tiles {
            tile.at[2] -= height(&plane, tile.at);
        }
        self.off_m.fill(0.0);
        for above_m in ABOVE_M {
            self.assemble(above_m);
            for _ in 0..SWEEPS {
                self.sweep();
            }
        }
        for (node, height_m) in self.heights_m.iter_mut().enumerate() {
            let [x, y] = place_m(node);
            *height_m = (height(&plane, [x, y, 0.0]) + self.off_m[node]) as f32;
        }
        &self.heights_m
    }

    /// What [`GroundGrid::find`] found last.
    pub fn heights_m(&self) -> &[f32] {
        &self.heights_m
    }

    /// The normal equations with each tile's say at the surface as it is.
    fn assemble(&mut self, above_m: f64) {
        for (node, row) in self.rows.iter_mut().enumerate() {
            *row = Row::default();
            row.own = TO_PLANE;
            let [x, y] = [node % SIDE, node / SIDE];
            let inside = [y > 0, x > 0, x + 1 < SIDE, y + 1 < SIDE];
            for (slot, inside) in [1, 3, 5, 7].into_iter().zip(inside) {
                if inside {
                    row.own += MEMBRANE;
                    row.around[slot] = -MEMBRANE;
                }
            }
        }
        for tile in &self.tiles {
            let corners = || CORNERS.iter().zip(tile.shares);
            let surface: f64 = corners()
                .map(|(step, share)| share * self.off_m[tile.node + step])
                .sum();
            let weight = say(tile.at[2] - surface, above_m);
            for (i, (step, share)) in corners().enumerate() {
                let row = &mut self.rows[tile.node + step];
                row.own += weight * share * share;
                row.right += weight * share * tile.at[2];
                for (j, other) in tile.shares.into_iter().enumerate() {
                    if i != j {
                        let (dx, dy) = (j % 2 + 1 - i % 2, j / 2 + 1 - i / 2);
                        row.around[dy * 3 + dx] += weight * share * other;
                    }
                }
            }
        }
    }

    /// Each node takes the value that its row asks for.
    fn sweep(&mut self) {
        for node in 0..GROUND_NODES {
            let row = &self.rows[node];
            let [x, y] = [node % SIDE, node / SIDE];
            let mut right = row.right;
            for dy in usize::from(y == 0)..(SIDE + 1 - y).min(3) {
                for dx in usize::from(x == 0)..(SIDE + 1 - x).min(3) {
                    let other = (y + dy - 1) * SIDE + x + dx - 1;
                    if other != node {
                        right -= row.around[dy * 3 + dx] * self.off_m[other];
                    }
                }
            }
            self.off_m[node] = right / row.own;
        }
    }
}

/// How much a point so far above (or below) the surface has to say, 0..1.
fn say(above_m: f64, scale_m: f64) -> f64 {
    let scale_m = if above_m > 0.0 {
        scale_m
    } else {
        BELOW * scale_m
    };
    let ratio = above_m / scale_m;
    1.0 / (1.0 + ratio * ratio).powi(2)
}

/// x, y of a node, m.
fn place_m(node: usize) -> [f64; 2] {
    [node % SIDE, node / SIDE].map(|i| f64::from(i as f32 * SPACING_M - HALF_M))
}

fn tile(at: [f32; 3]) -> Option<Tile> {
    let [along_x, along_y] = [at[0], at[1]].map(|v| f64::from((v + HALF_M) / SPACING_M));
    let inside = 0.0..(SIDE - 1) as f64;
    if !inside.contains(&along_x) || !inside.contains(&along_y) {
        return None;
    }
    let (fx, fy) = (along_x.fract(), along_y.fract());
    Some(Tile {
        at: at.map(f64::from),
        node: along_y as usize * SIDE + along_x as usize,
        shares: [
            (1.0 - fx) * (1.0 - fy),
            fx * (1.0 - fy),
            (1.0 - fx) * fy,
            fx * fy,
        ],
    })
}

/// z = p[0] x + p[1] y + p[2].
type Plane = [f64; 3];

fn height(plane: &Plane, [x, y, _]: [f64; 3]) -> f64 {
    plane[0] * x + plane[1] * y + plane[2]
}

/// The plane through the tiles near the sensor, from a flat one at `start`.
fn plane(tiles: &[Tile], start: f64) -> Plane {
    let mut plane = [0.0, 0.0, start];
    for above_m in ABOVE_M {
        let mut normal = Matrix3::from_diagonal(&Vector3::new(SLOPE_COST, SLOPE_COST, 1e-6));
        let mut right = Vector3::new(0.0, 0.0, 1e-6 * plane[2]);
        for tile in tiles {
            let [x, y, z] = tile.at;
            if x * x + y * y < PLANE_RADIUS_M * PLANE_RADIUS_M {
                let row = Vector3::new(x, y, 1.0);
                let weight = say(z - height(&plane, tile.at), above_m);
                normal += weight * row * row.transpose();
                right += weight * z * row;
            }
        }
        match normal.cholesky() {
            Some(factors) => plane = factors.solve(&right).into(),
            None => break,
        }
    }
    plane
}

/// z of the ground at x, y (m) between the nodes of a [`GroundGrid`]; beyond the grid that of its edge; NaN for NaN.
#[inline(always)]
pub fn ground_height_m(heights_m: &[f32], [x_m, y_m]: [f32; 2]) -> f32 {
    let along = |v: f32| {
        let v = ((v + HALF_M) / SPACING_M).clamp(0.0, (SIDE - 1) as f32);
        let low = (v as usize).min(SIDE - 2);
        (low, v - low as f32)
    };
    let ((ix, fx), (iy, fy)) = (along(x_m), along(y_m));
    let row = |iy: usize| {
        let at = iy * SIDE + ix;
        heights_m[at] + fx * (heights_m[at + 1] - heights_m[at])
    };
    let (low, high) = (row(iy), row(iy + 1));
    low + fy * (high - low)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slope_is_followed_between_the_nodes() {
        let slope = |x: f32, y: f32| -1.2 + 0.04 * x - 0.02 * y;
        let points: Vec<[f32; 4]> = (0..400 * 400)
            .map(|i| [i / 400, i % 400].map(|i| -50.0 + 0.25 * i as f32))
            .map(|[x, y]| [x, y, slope(x, y), 0.0])
            .collect();
        let mut grid = GroundGrid::new(1.7);
        let heights_m = grid.find(&points).to_vec();
        for place @ [x, y] in [[0.0, 0.0], [13.3, -27.1], [-39.0, 31.7]] {
            let off = ground_height_m(&heights_m, place) - slope(x, y);
            // The lowest point of a tile is its lower edge.
            assert!(off.abs() < 0.06, "{place:?}: {off}");
        }
        let flat = grid.find(&[]);
        assert!((ground_height_m(flat, [-300.0, 900.0]) + 1.7).abs() < 1e-6);
        assert!(ground_height_m(flat, [f32::NAN, 900.0]).is_nan());
    }
}
