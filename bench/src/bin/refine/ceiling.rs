//! What the labelled points themselves reach: L-shape and extension to the ground on an object's own points.

use mluc_geometry::{Box3, iou_3d};
use mluc_ipc_types::Point;
use mluc_refiner::fit::{Closeness, ClusterPoints, Extend};
use mluc_refiner::{FrameIndex, GroundPlane, Settings};

use crate::scene::inside;

/// Of the ground under an object, m.
const AROUND_M: f64 = 8.0;

/// IoU of the box around the points inside an object's label, ground left out, with the label.
pub(crate) fn ceiling(
    points: &[Point],
    object: &Box3,
    frame: &mut FrameIndex,
    height_m: f64,
) -> f64 {
    let clearance_m = Settings::default().ground_clearance_m;
    let center = [object.center_m[0], object.center_m[1]];
    frame.start();
    frame.want(center, AROUND_M);
    frame.sort(points);
    let plane = GroundPlane::fit(frame, center, height_m);
    let mut own = ClusterPoints::default();
    own.look_at(center);
    for p in inside(points, object) {
        let [x, y, z] = [p.x_m, p.y_m, p.z_m].map(f64::from);
        if z - plane.z_at_m(x, y) >= clearance_m {
            own.push((x - center[0]) as f32, (y - center[1]) as f32, p.z_m);
        }
    }
    let extend = Extend {
        to_ground: true,
        away_from_sensor: None,
        end_faces: [None; 2],
        cut_top: None,
        size_min_m: [0.1; 3],
    };
    let tight = Closeness::default().fit(&own);
    let fitted = extend.box_around(&own, &tight, center, &plane);
    fitted.map_or(0.0, |fitted| iou_3d(&fitted, object))
}
