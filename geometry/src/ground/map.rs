//! The ground of a whole frame: a plane at every node of a coarse grid, blended between the nodes.
//!
//! Each node's plane is [`GroundPlane`], the same that a single candidate gets. A node without enough to go by, or whose
//! plane leaves its neighbour's on the side of the sensor by more than a kerb and a slope explain (a roof, a hedge),
//! continues that neighbour flat. Between nodes heights are blended linearly, so the ground has no steps.

use super::tiles::HALF_EXTENT_M;
use super::{GroundPlane, Lowest};

/// Distance between nodes, m: half of what a plane's cells span, so that neighbours share half of them.
const SPACING_M: f64 = 8.0;
/// Nodes along a side: both ends of the frame's square are nodes.
const NODES: usize = (2.0 * HALF_EXTENT_M / SPACING_M) as usize + 1;
/// The node at the sensor, along one side.
const MIDDLE: usize = NODES / 2;
/// Between neighbouring nodes the ground rises or falls no more than this, m: 15 % and a kerb.
const STEP_MAX_M: f64 = 1.4;

/// The ground of one frame. A node's plane is fitted when it is first asked for.
#[derive(Clone, Debug)]
pub struct GroundMap {
    sensor_height_m: f64,
    nodes: Vec<Option<GroundPlane>>,
}

impl GroundMap {
    /// For a sensor so high above the ground, m.
    pub fn new(sensor_height_m: f64) -> GroundMap {
        GroundMap {
            sensor_height_m,
            nodes: vec![None; NODES * NODES],
        }
    }

    /// Forgets the last frame.
    pub fn clear(&mut self) {
        self.nodes.fill(None);
    }

    /// The plane of a node; those nearer the sensor that it may fall back to are fitted first.
    fn node(&mut self, lowest: &Lowest, node: usize) -> GroundPlane {
        if let Some(plane) = self.nodes[node] {
            return plane;
        }
        let center_m = center_m(node);
        let inner = inner_neighbour(node).map(|inner| GroundPlane {
            origin_m: center_m,
            height_m: self.node(lowest, inner).z_at_m(center_m[0], center_m[1]),
            slope: [0.0; 2],
        });
        let fits = |plane: &GroundPlane| {
            inner.is_none_or(|inner| (plane.height_m - inner.height_m).abs() <= STEP_MAX_M)
        };
        let found = GroundPlane::find(lowest, center_m).filter(fits).or(inner);
        let plane = found.unwrap_or_else(|| GroundPlane::flat(center_m, self.sensor_height_m));
        self.nodes[node] = Some(plane);
        plane
    }

    /// The ground around a place: blended between the four nodes around it.
    pub fn plane_at(&mut self, lowest: &Lowest, [x_m, y_m]: [f64; 2]) -> GroundPlane {
        let along = |v: f64| {
            let v = ((v + HALF_EXTENT_M) / SPACING_M).clamp(0.0, (NODES - 1) as f64);
            let low = (v as usize).min(NODES - 2);
            (low, v - low as f64)
        };
        let ((ix, fx), (iy, fy)) = (along(x_m), along(y_m));
        let mut blended = GroundPlane::flat([x_m, y_m], 0.0);
        for (iy, wy) in [(iy, 1.0 - fy), (iy + 1, fy)] {
            for (ix, wx) in [(ix, 1.0 - fx), (ix + 1, fx)] {
                let node = self.node(lowest, iy * NODES + ix);
                let weight = wx * wy;
                blended.height_m += weight * node.z_at_m(x_m, y_m);
                blended.slope[0] += weight * node.slope[0];
                blended.slope[1] += weight * node.slope[1];
            }
        }
        blended
    }
}

fn place(node: usize) -> [usize; 2] {
    [node % NODES, node / NODES]
}

fn center_m(node: usize) -> [f64; 2] {
    place(node).map(|i| i as f64 * SPACING_M - HALF_EXTENT_M)
}

/// The neighbour one step nearer the sensor along each axis on which there is a step; none for the node at the sensor.
fn inner_neighbour(node: usize) -> Option<usize> {
    let nearer = |i: usize| i + usize::from(i < MIDDLE) - usize::from(i > MIDDLE);
    let [x, y] = place(node).map(nearer);
    let inner = y * NODES + x;
    (inner != node).then_some(inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A road that rises 5 % ahead and bends to flat at 20 m.
    fn road_m(x: f32) -> f32 {
        -1.73 + 0.05 * x.clamp(0.0, 20.0)
    }

    fn lowest(roof: bool) -> Lowest {
        let mut lowest = Lowest::default();
        let at = |i: usize| -30.0 + 0.25 * i as f32;
        let road = (0..240 * 240).map(|i| [at(i / 240), at(i % 240), road_m(at(i / 240))]);
        let place = |i: usize| [40.0 + 0.25 * (i / 80) as f32, 0.25 * (i % 80) as f32, 6.0];
        let roof = (0..if roof { 80 * 80 } else { 0 }).map(place);
        lowest.add(road.chain(roof));
        lowest
    }

    #[test]
    fn a_bending_road_is_followed() {
        let (lowest, mut map) = (lowest(false), GroundMap::new(1.73));
        for x in [-20.0, 0.0, 10.0, 18.0, 25.0] {
            let off = map.plane_at(&lowest, [x, 3.0]).height_m - f64::from(road_m(x as f32));
            assert!(off.abs() < 0.12, "{x}: {off}");
        }
    }

    #[test]
    fn without_points_the_ground_is_flat_below_the_sensor() {
        let (lowest, mut map) = (Lowest::default(), GroundMap::new(1.73));
        for place in [[0.0, 0.0], [55.0, -70.0], [500.0, 0.0]] {
            assert!((map.plane_at(&lowest, place).height_m + 1.73).abs() < 1e-9);
        }
    }

    #[test]
    fn a_roof_is_no_ground() {
        let (lowest, mut map) = (lowest(true), GroundMap::new(1.73));
        let height = map.plane_at(&lowest, [50.0, 8.0]).height_m;
        assert!(height < 0.5, "{height}");
    }
}
