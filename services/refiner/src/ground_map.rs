//! The ground of a whole frame: a plane at every node of a coarse grid, blended between the nodes.
//!
//! Each node's plane is [`GroundPlane`], the same that a single candidate gets. A node without enough to go by, or whose
//! plane leaves its neighbour's on the side of the sensor by more than a kerb and a slope explain (a roof, a hedge),
//! continues that neighbour flat. Between nodes heights are blended linearly, so the ground has no steps.

use crate::frame::{FrameIndex, HALF_EXTENT_M, IndexedPoint};
use crate::ground::GroundPlane;

/// Distance between nodes, m: half of what a plane's cells span, so that neighbours share half of them.
const SPACING_M: f64 = 8.0;
/// Nodes along a side: both ends of the frame's square are nodes.
const NODES: usize = (2.0 * HALF_EXTENT_M / SPACING_M) as usize + 1;
/// The node at the sensor, along one side.
const MIDDLE: usize = NODES / 2;
/// Between neighbouring nodes the ground rises or falls no more than this, m: 15 % and a kerb.
const STEP_MAX_M: f64 = 1.4;

/// The ground of one frame; buffers are reused.
#[derive(Debug)]
pub struct GroundMap {
    nodes: Vec<GroundPlane>,
    /// From the sensor outwards, each after the neighbour that it falls back to.
    outwards: Vec<u32>,
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

impl Default for GroundMap {
    fn default() -> GroundMap {
        let mut outwards: Vec<u32> = (0..(NODES * NODES) as u32).collect();
        outwards.sort_by_key(|&node| {
            let [x, y] = place(node as usize).map(|i| i as isize - MIDDLE as isize);
            (x * x + y * y, node)
        });
        GroundMap {
            nodes: vec![GroundPlane::flat([0.0; 2], 0.0); NODES * NODES],
            outwards,
        }
    }
}

impl GroundMap {
    /// Fits the ground under all points that the frame holds.
    pub fn fit(&mut self, frame: &FrameIndex, sensor_height_m: f64) {
        for &node in &self.outwards {
            let node = node as usize;
            let center_m = center_m(node);
            let inner = inner_neighbour(node).map(|inner| GroundPlane {
                origin_m: center_m,
                height_m: self.nodes[inner].z_at_m(center_m[0], center_m[1]),
                slope: [0.0; 2],
            });
            let fits = |plane: &GroundPlane| {
                let step_m = |inner: GroundPlane| (plane.height_m - inner.height_m).abs();
                inner.is_none_or(|inner| step_m(inner) <= STEP_MAX_M)
            };
            let found = GroundPlane::find(frame, center_m).filter(fits);
            self.nodes[node] = found
                .or(inner)
                .unwrap_or_else(|| GroundPlane::flat(center_m, sensor_height_m));
        }
    }

    /// The ground around a place: blended between the four nodes around it.
    pub fn plane_at(&self, [x_m, y_m]: [f64; 2]) -> GroundPlane {
        let along = |v: f64| {
            let v = ((v + HALF_EXTENT_M) / SPACING_M).clamp(0.0, (NODES - 1) as f64);
            let low = (v as usize).min(NODES - 2);
            (low, v - low as f64)
        };
        let ((ix, fx), (iy, fy)) = (along(x_m), along(y_m));
        let mut blended = GroundPlane::flat([x_m, y_m], 0.0);
        let corners = [
            (0, 0, (1.0 - fx) * (1.0 - fy)),
            (1, 0, fx * (1.0 - fy)),
            (0, 1, (1.0 - fx) * fy),
            (1, 1, fx * fy),
        ];
        for (dx, dy, weight) in corners {
            let node = &self.nodes[(iy + dy) * NODES + ix + dx];
            blended.height_m += weight * node.z_at_m(x_m, y_m);
            blended.slope[0] += weight * node.slope[0];
            blended.slope[1] += weight * node.slope[1];
        }
        blended
    }

    /// Hands every point that the frame holds, with its height above the ground, m, cell by cell.
    ///
    /// Within a cell of 1 m the ground is the plane of its middle.
    pub fn for_each_height(&self, frame: &FrameIndex, mut take: impl FnMut(&IndexedPoint, f32)) {
        for (corner, points) in frame.occupied_cells() {
            let middle = corner.map(|v| v + 0.5);
            let plane = self.plane_at(middle);
            let [x, y] = middle.map(|v| v as f32);
            let (z, [sx, sy]) = (plane.height_m as f32, plane.slope.map(|s| s as f32));
            for point in points {
                let at = point.at_m;
                take(point, at[2] - (z + sx * (at[0] - x) + sy * (at[1] - y)));
            }
        }
    }

    /// A label for every point of the scan that the frame was sorted from; `labels` is overwritten.
    pub fn label(
        &self,
        frame: &FrameIndex,
        points: usize,
        clearance_m: f64,
        labels: &mut Vec<GroundLabel>,
    ) {
        labels.clear();
        labels.resize(points, GroundLabel::Outside);
        let clearance = clearance_m as f32;
        self.for_each_height(frame, |point, height| {
            labels[point.index as usize] = if height < clearance {
                GroundLabel::Ground
            } else {
                GroundLabel::Standing
            };
        });
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
    let nearer = |i: usize| match i.cmp(&MIDDLE) {
        std::cmp::Ordering::Less => i + 1,
        std::cmp::Ordering::Equal => i,
        std::cmp::Ordering::Greater => i - 1,
    };
    let [x, y] = place(node).map(nearer);
    let inner = y * NODES + x;
    (inner != node).then_some(inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_ipc_types::Point;

    fn map_of(scan: &[Point]) -> (FrameIndex, GroundMap) {
        let mut frame = FrameIndex::default();
        frame.want_all();
        frame.sort(scan);
        let mut map = GroundMap::default();
        map.fit(&frame, 1.73);
        (frame, map)
    }

    /// A road that rises 5 % ahead and bends to flat at 20 m, with boxes on it; true: on a box.
    fn road() -> (Vec<Point>, Vec<bool>) {
        let mut scan = Vec::new();
        let mut standing = Vec::new();
        for i in 0..240 {
            for j in 0..240 {
                let (x, y) = (-30.0 + 0.25 * i as f32, -30.0 + 0.25 * j as f32);
                let on_box = x.rem_euclid(10.0) < 3.5 && y.rem_euclid(8.0) < 1.6;
                let z = -1.73 + 0.05 * x.clamp(0.0, 20.0) + if on_box { 1.2 } else { 0.0 };
                scan.push(Point {
                    x_m: x,
                    y_m: y,
                    z_m: z,
                    intensity: 0.0,
                });
                standing.push(on_box);
            }
        }
        (scan, standing)
    }

    #[test]
    fn a_bending_road_with_boxes_is_told_from_them() {
        let (scan, standing) = road();
        let (frame, map) = map_of(&scan);
        let mut labels = Vec::new();
        map.label(&frame, scan.len(), 0.2, &mut labels);
        let wrong = labels.iter().zip(&standing).filter(|&(&label, &standing)| {
            label
                != if standing {
                    GroundLabel::Standing
                } else {
                    GroundLabel::Ground
                }
        });
        let share = wrong.count() as f64 / scan.len() as f64;
        assert!(share < 0.005, "{share}");
    }

    #[test]
    fn points_that_the_frame_left_out_are_outside() {
        let (mut scan, _) = road();
        scan[5].x_m = f32::NAN;
        scan[6].y_m = 500.0;
        let (frame, map) = map_of(&scan);
        let mut labels = Vec::new();
        map.label(&frame, scan.len(), 0.2, &mut labels);
        let outside = labels
            .iter()
            .filter(|&&l| l == GroundLabel::Outside)
            .count();
        assert_eq!(
            (outside, labels[5], labels[6]),
            (2, GroundLabel::Outside, GroundLabel::Outside)
        );
    }

    #[test]
    fn without_points_the_ground_is_flat_below_the_sensor() {
        let (_, map) = map_of(&[]);
        for place in [[0.0, 0.0], [55.0, -70.0], [500.0, 0.0]] {
            assert!((map.plane_at(place).height_m + 1.73).abs() < 1e-9);
        }
    }

    #[test]
    fn a_roof_is_no_ground() {
        let (mut scan, _) = road();
        for i in 0..80 {
            for j in 0..80 {
                let (x, y) = (40.0 + 0.25 * i as f32, 0.25 * j as f32);
                scan.push(Point {
                    x_m: x,
                    y_m: y,
                    z_m: 6.0,
                    intensity: 0.0,
                });
            }
        }
        let (_, map) = map_of(&scan);
        let height = map.plane_at([50.0, 8.0]).height_m;
        assert!(height < 0.5, "{height}");
    }
}
