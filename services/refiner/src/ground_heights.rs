//! Points of a frame with their heights above the ground.

use mluc_geometry::ground::tiles::middle_m;
use mluc_geometry::ground::{GroundMap, GroundPlane};

use crate::frame::{FrameIndex, IndexedPoint};

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

/// The points of a tile with their heights above the ground, m: above the plane of the tile's middle.
pub(crate) fn heights<'a>(
    ground: &mut GroundMap,
    frame: &'a FrameIndex,
    tile: usize,
) -> impl Iterator<Item = (&'a IndexedPoint, f32)> + use<'a> {
    let points = frame.points_in(tile);
    let middle = middle_m(tile);
    let plane = if points.is_empty() {
        GroundPlane::flat(middle, 0.0)
    } else {
        ground.plane_at(&frame.lowest, middle)
    };
    let [x, y] = middle.map(|v| v as f32);
    let (z, [sx, sy]) = (plane.height_m as f32, plane.slope.map(|s| s as f32));
    points.iter().map(move |point| {
        let at = point.at_m;
        (point, at[2] - (z + sx * (at[0] - x) + sy * (at[1] - y)))
    })
}

/// A label for every point of the scan that the frame was sorted from; `labels` is overwritten.
pub fn label_ground(
    ground: &mut GroundMap,
    frame: &FrameIndex,
    points: usize,
    clearance_m: f64,
    labels: &mut Vec<GroundLabel>,
) {
    labels.clear();
    labels.resize(points, GroundLabel::Outside);
    for tile in frame.occupied_tiles() {
        for (point, height) in heights(ground, frame, tile) {
            labels[point.index as usize] = if height < clearance_m as f32 {
                GroundLabel::Ground
            } else {
                GroundLabel::Standing
            };
        }
    }
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
        label_ground(&mut map, &frame, scan.len(), 0.2, &mut labels);
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
}
