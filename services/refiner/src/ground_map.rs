//! The ground of a whole frame: a plane at every node of a coarse grid, blended between the nodes.
//!
//! Each node's plane is [`GroundPlane`], the same that a single candidate gets. A node without enough to go by, or whose
//! plane leaves its neighbour's on the side of the sensor by more than a kerb and a slope explain (a roof, a hedge),
//! continues that neighbour flat. Between nodes heights are blended linearly, so the ground has no steps.

use crate::frame::{FrameIndex, HALF_EXTENT_M, IndexedPoint, middle_m};
use crate::ground::GroundPlane;

/// Distance between nodes, m: half of what a plane's cells span, so that neighbours share half of them.
const SPACING_M: f64 = 8.0;
/// Nodes along a side: both ends of the frame's square are nodes.
const NODES: usize = (2.0 * HALF_EXTENT_M / SPACING_M) as usize + 1;
/// The node at the sensor, along one side.
const MIDDLE: usize = NODES / 2;
/// Between neighbouring nodes the ground rises or falls no more than this, m: 15 % and a kerb.
const STEP_MAX_M: f64 = 1.4;

/// The ground of one frame. A node's plane is fitted when it is first asked for.
#[derive(Debug)]
pub struct GroundMap {
    sensor_height_m: f64,
    nodes: Vec<Option<GroundPlane>>,
}

/// Whether a point is ground.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GroundLabel {
    /// Lower than the clearance above the ground.
    Ground,
    /// Higher.
    Standing,
    /// Not finite, or outside of the area looked at.
    Outside,
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
    fn node(&mut self, frame: &FrameIndex, node: usize) -> GroundPlane {
        if let Some(plane) = self.nodes[node] {
            return plane;
        }
        let center_m = center_m(node);
        let inner = inner_neighbour(node).map(|inner| GroundPlane {
            origin_m: center_m,
            height_m: self.node(frame, inner).z_at_m(center_m[0], center_m[1]),
            slope: [0.0; 2],
        });
        let fits = |plane: &GroundPlane| {
            inner.is_none_or(|inner| (plane.height_m - inner.height_m).abs() <= STEP_MAX_M)
        };
        let found = GroundPlane::find(frame, center_m).filter(fits).or(inner);
        let plane = found.unwrap_or_else(|| GroundPlane::flat(center_m, self.sensor_height_m));
        self.nodes[node] = Some(plane);
        plane
    }

    /// The ground around a place: blended between the four nodes around it.
    pub fn plane_at(&mut self, frame: &FrameIndex, [x_m, y_m]: [f64; 2]) -> GroundPlane {
        let along = |v: f64| {
            let v = ((v + HALF_EXTENT_M) / SPACING_M).clamp(0.0, (NODES - 1) as f64);
            let low = (v as usize).min(NODES - 2);
            (low, v - low as f64)
        };
        let ((ix, fx), (iy, fy)) = (along(x_m), along(y_m));
        let mut blended = GroundPlane::flat([x_m, y_m], 0.0);
        for (iy, wy) in [(iy, 1.0 - fy), (iy + 1, fy)] {
            for (ix, wx) in [(ix, 1.0 - fx), (ix + 1, fx)] {
                let node = self.node(frame, iy * NODES + ix);
                let weight = wx * wy;
                blended.height_m += weight * node.z_at_m(x_m, y_m);
                blended.slope[0] += weight * node.slope[0];
                blended.slope[1] += weight * node.slope[1];
            }
        }
        blended
    }

    /// The points of a tile with their heights above the ground, m: above the plane of the tile's middle.
    pub(crate) fn heights<'a>(
        &mut self,
        frame: &'a FrameIndex,
        tile: usize,
    ) -> impl Iterator<Item = (&'a IndexedPoint, f32)> + use<'a> {
        let points = frame.points_in(tile);
        let middle = middle_m(tile);
        let plane = if points.is_empty() {
            GroundPlane::flat(middle, 0.0)
        } else {
            self.plane_at(frame, middle)
        };
        let [x, y] = middle.map(|v| v as f32);
        let (z, [sx, sy]) = (plane.height_m as f32, plane.slope.map(|s| s as f32));
        points.iter().map(move |point| {
            let at = point.at_m;
            (point, at[2] - (z + sx * (at[0] - x) + sy * (at[1] - y)))
        })
    }

    /// A label for every point of the scan that the frame was sorted from; `labels` is overwritten.
    pub fn label(
        &mut self,
        frame: &FrameIndex,
        points: usize,
        clearance_m: f64,
        labels: &mut Vec<GroundLabel>,
    ) {
        labels.clear();
        labels.resize(points, GroundLabel::Outside);
        for tile in frame.occupied_tiles() {
            for (point, height) in self.heights(frame, tile) {
                labels[point.index as usize] = if height < clearance_m as f32 {
                    GroundLabel::Ground
                } else {
                    GroundLabel::Standing
                };
            }
        }
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
    use mluc_ipc_types::Point;

    use super::*;
    use crate::testing::{point, sorted};

    /// A road that rises 5 % ahead and bends to flat at 20 m, with boxes on it; true: on a box.
    fn road() -> (Vec<Point>, Vec<bool>) {
        let points = (0..240 * 240).map(|i| {
            let [x, y] = [i / 240, i % 240].map(|i| -30.0 + 0.25 * i as f32);
            let on_box = x.rem_euclid(10.0) < 3.5 && y.rem_euclid(8.0) < 1.6;
            let z = -1.73 + 0.05 * x.clamp(0.0, 20.0) + if on_box { 1.2 } else { 0.0 };
            (point([x, y, z]), on_box)
        });
        points.unzip()
    }

    #[test]
    fn a_bending_road_with_boxes_is_told_from_them() {
        let (mut scan, standing) = road();
        scan[5].x_m = f32::NAN;
        scan[6].y_m = 500.0;
        let (frame, mut map) = (sorted(&scan), GroundMap::new(1.73));
        let mut labels = Vec::new();
        map.label(&frame, scan.len(), 0.2, &mut labels);
        assert_eq!(labels[5..7], [GroundLabel::Outside; 2], "left out");
        let is_right = |(&label, &standing): (&GroundLabel, &bool)| match label {
            GroundLabel::Standing => standing,
            GroundLabel::Ground => !standing,
            GroundLabel::Outside => false,
        };
        let right = labels.iter().zip(&standing).filter(|&pair| is_right(pair));
        let share = right.count() as f64 / scan.len() as f64;
        assert!(share > 0.995, "{share}");
    }

    #[test]
    fn without_points_the_ground_is_flat_below_the_sensor() {
        let (frame, mut map) = (sorted(&[]), GroundMap::new(1.73));
        for place in [[0.0, 0.0], [55.0, -70.0], [500.0, 0.0]] {
            assert!((map.plane_at(&frame, place).height_m + 1.73).abs() < 1e-9);
        }
    }

    #[test]
    fn a_roof_is_no_ground() {
        let (mut scan, _) = road();
        scan.extend((0..80 * 80).map(|i| {
            let [x, y] = [i / 80, i % 80].map(|i| 0.25 * i as f32);
            point([40.0 + x, y, 6.0])
        }));
        let (frame, mut map) = (sorted(&scan), GroundMap::new(1.73));
        let height = map.plane_at(&frame, [50.0, 8.0]).height_m;
        assert!(height < 0.5, "{height}");
    }
}
