//! The height of the ground on a grid. Heights in the network's input, of boxes and of clusters are measured from it.
//!
//! Robust least squares fits a surface to the lowest points of the tiles: first a plane, then the offsets from the plane, smoothed by a membrane
//! between the nodes. Tiles join from the sensor outwards, so that new points are weighted by the ground that is already known: a road may rise and
//! fall. The weight of a point above the surface falls fast (objects stand on the ground); the weight of a point below falls more slowly. Without
//! points the surface follows the plane; beyond the grid its height is the height at the nearest place of the grid's edge.

use super::{GroundPlane, Lowest};

/// Distance between nodes, m.
const SPACING_M: f32 = 4.0;
/// Distance from the sensor to the outermost nodes along x and y, m.
pub const GROUND_HALF_M: f32 = 56.0;
const SIDE: usize = (2.0 * GROUND_HALF_M / SPACING_M) as usize + 1;
/// Nodes of the grid.
pub const GROUND_NODES: usize = SIDE * SIDE;
/// The equations have a border of nodes without links, so that each node of the grid has eight around it.
const WIDTH: usize = SIDE + 2;
/// Height scale of the weight, m: points farther above the surface get little weight. One scale per pass after a tile has joined.
const ABOVE_M: [f64; 7] = [0.6, 0.45, 0.3, 0.2, 0.15, 0.12, 0.12];
/// Below the surface the height scale is multiplied by this factor.
const BELOW: f64 = 2.5;
/// Tiles nearer than the first radius join in the first pass, tiles nearer than the second radius in the second pass, and so on, m.
const JOIN_RADIUS_M: [f32; 4] = [9.0, 15.0, 23.0, 33.0];
/// The plane is fitted to tiles nearer than this, m. The fit starts at the most common height around the sensor (half side, range and step, m).
const PLANE_RADIUS_M: f32 = 30.0;
const COMMON_HALF_M: f32 = 20.0;
const COMMON_Z_M: std::ops::Range<f32> = -6.0..1.0;
const COMMON_STEP_M: f32 = 0.25;
/// Cost of the plane's slopes, in tiles that are 1 m off: without points the plane is level.
const SLOPE_COST: f64 = 2000.0;
/// Cost of a difference between neighbouring nodes, in tiles: near the sensor, and far from it, where the lowest points are often not ground.
const MEMBRANE: [f64; 2] = [0.2, 0.6];
/// The distances from the sensor that count as near and as far, m.
const MEMBRANE_RADIUS_M: [f64; 2] = [20.0, 40.0];
/// Cost of a difference from the plane, in tiles.
const TO_PLANE: f64 = 0.01;
/// Sweeps over the nodes in a pass.
const SWEEPS: usize = 12;

/// The lowest point of a tile, and its position among the four nodes around it.
#[derive(Clone, Copy, Debug)]
struct Tile {
    /// Height above the plane, m.
    z_m: f64,
    /// The node towards -x and -y.
    node: usize,
    /// Interpolation weights of the nodes at [`CORNERS`] from `node`.
    shares: [f64; 4],
    /// The pass in which it joins.
    joins: usize,
}

/// Index steps from a tile's `node` to the four nodes around the tile.
const CORNERS: [usize; 4] = [0, 1, WIDTH, WIDTH + 1];
/// Index steps from a node to the four of its eight neighbours that come later; pairs of corners, each with the number of the step between them.
const NEXT: [usize; 4] = [WIDTH + 1, WIDTH, WIDTH - 1, 1];
const PAIRS: [[usize; 3]; 6] = [[0, 3, 0], [0, 2, 1], [1, 3, 1], [1, 2, 2], [0, 1, 3], [2, 3, 3]];

/// A node's row of the symmetric normal equations: the diagonal entry, the entries of the nodes at [`NEXT`], and the right-hand side.
#[derive(Clone, Copy, Debug, Default)]
struct Row {
    own: f64,
    next: [f64; 4],
    right: f64,
}

/// Finds the ground of each scan; buffers are reused.
#[derive(Clone, Debug)]
pub struct GroundGrid {
    lowest: Lowest,
    points: Vec<[f32; 3]>,
    tiles: Vec<Tile>,
    /// The equations without points (`membrane`) and with points (`rows`).
    membrane: Vec<Row>,
    rows: Vec<Row>,
    /// Offset of each node from the plane, m.
    off_m: Vec<f64>,
    heights_m: Vec<f32>,
    sensor_height_m: f64,
}

impl GroundGrid {
    /// `sensor_height_m`: height of the sensor above the ground, m, used where a scan has too few points.
    pub fn new(sensor_height_m: f64) -> GroundGrid {
        let tiles_max = (4.0 * GROUND_HALF_M * GROUND_HALF_M) as usize;
        GroundGrid {
            lowest: Lowest::default(),
            points: Vec::with_capacity(tiles_max),
            tiles: Vec::with_capacity(tiles_max),
            membrane: membrane(),
            rows: vec![Row::default(); WIDTH * WIDTH],
            off_m: vec![0.0; WIDTH * WIDTH],
            heights_m: vec![-sensor_height_m as f32; GROUND_NODES],
            sensor_height_m,
        }
    }

    /// The ground of a scan (x, y, z, m, intensity): z at each of the [`GROUND_NODES`] nodes, m, row by row along x; input of [`ground_height_m`].
    pub fn find(&mut self, points: &[[f32; 4]]) -> &[f32] {
        let mut lowest = std::mem::take(&mut self.lowest);
        lowest.find(points.iter().map(|&[x, y, z, _]| [x, y, z]));
        self.find_under(lowest.around([0.0; 2], GROUND_HALF_M.into()));
        self.lowest = lowest;
        &self.heights_m
    }

    /// As [`GroundGrid::find`], from the lowest point of every tile of 1 m; points beyond the grid are left out.
    pub fn find_under(&mut self, lowest: impl Iterator<Item = [f32; 3]>) -> &[f32] {
        self.points.clear();
        self.points.extend(lowest.filter(is_inside));
        let plane = self.plane();
        let tiles = self.points.iter().map(|&at| tile(at, &plane));
        self.tiles.clear();
        self.tiles.extend(tiles);
        self.off_m.fill(0.0);
        for pass in 0..JOIN_RADIUS_M.len() + ABOVE_M.len() {
            self.assemble(pass);
            for _ in 0..SWEEPS {
                self.sweep();
            }
        }
        for (at, height_m) in self.heights_m.iter_mut().enumerate() {
            let [x, y] = [at % SIDE, at / SIDE].map(|i| i as f32 * SPACING_M - GROUND_HALF_M);
            *height_m = (self.off_m[node(at)] - plane.above_m([x, y, 0.0])) as f32;
        }
        &self.heights_m
    }

    /// The heights that were found last, m.
    pub fn heights_m(&self) -> &[f32] {
        &self.heights_m
    }

    /// The plane through the tiles near the sensor.
    fn plane(&mut self) -> GroundPlane {
        let is_near = |[x, y, _]: &[f32; 3]| x.abs().max(y.abs()) <= COMMON_HALF_M;
        let is_in_circle = |[x, y, _]: &[f32; 3]| x * x + y * y < PLANE_RADIUS_M * PLANE_RADIUS_M;
        let near = self.points.iter().copied().filter(is_near);
        let flat = GroundPlane::common(near, 0, COMMON_Z_M, COMMON_STEP_M)
            .unwrap_or(GroundPlane { z_m: -self.sensor_height_m, slope: [0.0; 2] });
        let points = self.points.iter().copied().filter(is_in_circle);
        flat.fitted(points, &ABOVE_M, weight, SLOPE_COST)
    }

    /// Builds the normal equations; the present surface gives each tile's weight. At the end each diagonal entry becomes its reciprocal.
    fn assemble(&mut self, pass: usize) {
        self.rows.copy_from_slice(&self.membrane);
        for tile in self.tiles.iter().filter(|tile| tile.joins <= pass) {
            let above_m = ABOVE_M[(pass - tile.joins).min(ABOVE_M.len() - 1)];
            let nodes = CORNERS.map(|step| tile.node + step);
            let shares = tile.shares;
            let surface: f64 = (0..4).map(|i| shares[i] * self.off_m[nodes[i]]).sum();
            let weight = weight(tile.z_m - surface, above_m);
            let weighted = shares.map(|share| weight * share);
            for i in 0..4 {
                let row = &mut self.rows[nodes[i]];
                row.own += weighted[i] * shares[i];
                row.right += weighted[i] * tile.z_m;
            }
            for [i, j, next] in PAIRS {
                self.rows[nodes[i]].next[next] += weighted[i] * shares[j];
            }
        }
        for row in &mut self.rows {
            row.own = row.own.recip();
        }
    }

    /// One sweep (Gauss-Seidel): each node takes the value that solves its row.
    fn sweep(&mut self) {
        let (rows, off_m) = (&self.rows[..], &mut self.off_m[..]);
        for first in (1..=SIDE).map(|row| row * WIDTH + 1) {
            // The value of the previous node: a node waits for this value alone.
            let mut last_m = 0.0;
            for node in first..first + SIDE {
                let (row, mut right) = (&rows[node], rows[node].right);
                for (next, step) in NEXT.into_iter().enumerate() {
                    right -= row.next[next] * off_m[node + step];
                    if step != 1 {
                        right -= rows[node - step].next[next] * off_m[node - step];
                    }
                }
                last_m = right * row.own - rows[node - 1].next[3] * row.own * last_m;
                off_m[node] = last_m;
            }
        }
    }
}

/// The weight, 0 to 1, of a point at this height above (negative: below) the surface.
fn weight(above_m: f64, scale_m: f64) -> f64 {
    let scale_m = scale_m * if above_m > 0.0 { 1.0 } else { BELOW };
    let ratio = above_m / scale_m;
    let sum = 1.0 + ratio * ratio;
    1.0 / (sum * sum)
}

/// Index, in the equations, of the node with index `at` in the grid.
fn node(at: usize) -> usize {
    (at / SIDE + 1) * WIDTH + at % SIDE + 1
}

/// The equations without points.
fn membrane() -> Vec<Row> {
    let mut rows = vec![Row::default(); WIDTH * WIDTH];
    for at in 0..GROUND_NODES {
        rows[node(at)].own += TO_PLANE;
        let [x_m, y_m] = [at % SIDE, at / SIDE].map(|i| i as f64 * f64::from(SPACING_M));
        let half_m = f64::from(GROUND_HALF_M);
        let ([near, far], [near_m, far_m]) = (MEMBRANE, MEMBRANE_RADIUS_M);
        let share = ((x_m - half_m).hypot(y_m - half_m) - near_m) / (far_m - near_m);
        let cost = near + (far - near) * share.clamp(0.0, 1.0);
        for (next, is_inside) in [(1, at / SIDE + 1 < SIDE), (3, at % SIDE + 1 < SIDE)] {
            if is_inside {
                rows[node(at)].next[next] = -cost;
                rows[node(at)].own += cost;
                rows[node(at) + NEXT[next]].own += cost;
            }
        }
    }
    rows
}

fn is_inside([x, y, _]: &[f32; 3]) -> bool {
    let inside = -GROUND_HALF_M..GROUND_HALF_M;
    inside.contains(x) && inside.contains(y)
}

/// The tile of a point inside the grid.
fn tile(point: [f32; 3], plane: &GroundPlane) -> Tile {
    let along = [point[0], point[1]].map(|v| f64::from((v + GROUND_HALF_M) / SPACING_M));
    let [column, row] = along.map(|v| v as usize);
    let [fx, fy] = along.map(f64::fract);
    let x_shares = [1.0 - fx, fx];
    let radius_m = point[0].hypot(point[1]);
    let joins = JOIN_RADIUS_M.iter().filter(|limit_m| radius_m >= **limit_m);
    Tile {
        joins: joins.count(),
        z_m: plane.above_m(point),
        node: node(row * SIDE + column),
        shares: [0, 1, 2, 3].map(|i| x_shares[i % 2] * [1.0 - fy, fy][i / 2]),
    }
}

/// z of the ground at x, y (m), interpolated between the nodes of a [`GroundGrid`]; beyond the grid the value at its edge; NaN for NaN.
#[inline(always)]
pub fn ground_height_m(heights_m: &[f32], [x_m, y_m]: [f32; 2]) -> f32 {
    let along = |v: f32| {
        let v = ((v + GROUND_HALF_M) / SPACING_M).clamp(0.0, (SIDE - 1) as f32);
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
        let places = (0..400 * 400).map(|i| [i / 400, i % 400].map(|i| -50.0 + 0.25 * i as f32));
        let points: Vec<_> = places.map(|[x, y]| [x, y, slope(x, y), 0.0]).collect();
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

    #[test]
    fn the_road_over_a_canal_bridge_stays_the_ground() {
        // The road rises to a bridge 12 m ahead and falls behind it; water 2 m lower on both sides of the bridge.
        let road_m = |x: f32| -1.8 + 0.06 * x.clamp(0.0, 12.0) - 0.09 * (x - 12.0).max(0.0);
        let places = (0..400 * 400).map(|i| [i / 400, i % 400].map(|i| -50.0 + 0.25 * i as f32));
        let points: Vec<[f32; 4]> = places
            .map(|[x, y]| {
                let is_water = (10.0..14.0).contains(&x) && y.abs() > 8.0;
                [x, y, road_m(x) - if is_water { 2.0 } else { 0.0 }, 0.0]
            })
            .collect();
        let mut grid = GroundGrid::new(1.7);
        let ground_m = grid.find(&points);
        for x in [-10.0, 4.0, 9.0, 12.0, 20.0] {
            let off = ground_height_m(ground_m, [x, 0.8]) - road_m(x);
            assert!(off.abs() < 0.15, "{x}: {off}");
        }
    }

    #[test]
    fn a_bending_road_is_found_under_boxes_and_a_roof_is_no_ground() {
        // The road rises 5 % ahead and is level from 20 m on.
        let road_m = |x: f32| -1.73 + 0.05 * x.clamp(0.0, 20.0);
        let road = (0..240 * 240).map(|i| [i / 240, i % 240].map(|i| -30.0 + 0.25 * i as f32));
        let road = road.map(|[x, y]| {
            let is_box = x.rem_euclid(10.0) < 3.5 && y.rem_euclid(8.0) < 1.6;
            [x, y, road_m(x) + if is_box { 1.2 } else { 0.0 }, 0.0]
        });
        let roof = (0..80 * 80).map(|i| [i / 80, i % 80].map(|i| 0.25 * i as f32));
        let roof = roof.map(|[x, y]| [40.0 + x, y, 6.0, 0.0]);
        let points: Vec<[f32; 4]> = road.chain(roof).collect();
        let mut grid = GroundGrid::new(1.73);
        let ground_m = grid.find(&points);
        for place @ [x, _] in [-15.0, 1.0, 11.0, 18.0, 25.0].map(|x| [x, 0.8]) {
            let off = ground_height_m(ground_m, place) - road_m(x);
            assert!(off.abs() < 0.12, "{place:?}: {off}");
        }
        let under_roof = ground_height_m(ground_m, [50.0, 8.0]);
        assert!(under_roof < 0.5, "{under_roof}");
    }
}
