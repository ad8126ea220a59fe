//! The outline of a cluster seen from above: convex, at most sixteen corners, around every point.
//!
//! The tight rectangle is cut by the supporting lines of twelve more directions. The result is the convex hull up to its finest corners, never
//! smaller, in time linear in the points. Points on a line or on one spot get an outline 1 cm around them, so that it is always a polygon.

use super::{ClusterPoints, Rectangle};
use mluc_geometry::{Box3, Polygon};
use mluc_ipc_types::FOOTPRINT_MAX;
use std::f64::consts::FRAC_PI_2;

/// Number of directions within a quarter turn, the rectangle's own included; the outline has four times as many sides.
const DIRECTIONS: usize = FOOTPRINT_MAX / 4;
/// Corners closer than this count as one, m.
const SAME_CORNER_M: f64 = 1e-3;
/// A rectangle thinner than this is a line, m.
const THIN_M: f64 = 0.02;
/// Distance of the outline around a line, m.
const AROUND_M: f64 = 0.01;

/// An outline in the sensor frame, counter-clockwise.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Footprint {
    /// x and y, m; zeros beyond `count`.
    pub corners_m: [[f32; 2]; FOOTPRINT_MAX],
    /// Corners in use.
    pub count: usize,
}

impl Footprint {
    /// The outline around points and their tight rectangle.
    pub fn around(points: &ClusterPoints, rectangle: &Rectangle) -> Footprint {
        let [u, v] = rectangle.size_m();
        let around_m = if u.min(v) < THIN_M { AROUND_M } else { 0.0 };
        let found = Footprint::at_distance(points, rectangle, around_m);
        if found.count >= 3 {
            return found;
        }
        // A line at the angle of a cut leaves no polygon.
        Footprint::at_distance(points, rectangle, AROUND_M)
    }

    fn at_distance(points: &ClusterPoints, rectangle: &Rectangle, around_m: f64) -> Footprint {
        let mut polygon = Polygon::<CORNERS_MAX>::new(rectangle.grown(around_m).corners_m());
        let mut cut = |normal, limit_m| {
            let kept = polygon.cut(normal, limit_m);
            // A cut that would leave nothing, because of rounding, is skipped.
            if kept.corners().len() >= 3 {
                polygon = kept;
            }
        };
        for step in 1..DIRECTIONS {
            let turn = FRAC_PI_2 * step as f64 / DIRECTIONS as f64;
            for quarter in [0.0, FRAC_PI_2] {
                let (sin, cos) = (rectangle.yaw_rad + turn + quarter).sin_cos();
                let [low, high] = points.span_m([cos as f32, sin as f32]).map(f64::from);
                cut([cos, sin], high + around_m);
                cut([-cos, -sin], around_m - low);
            }
        }
        outline(polygon.corners(), points.origin_m)
    }

    pub(crate) fn of_box(shape: &Box3) -> Footprint {
        Footprint::of_corners(shape.footprint_m())
    }

    /// Corners beyond the contract's limit are left out.
    fn of_corners(corners: impl IntoIterator<Item = [f64; 2]>) -> Footprint {
        let mut footprint = Footprint::default();
        for (to, corner) in footprint.corners_m.iter_mut().zip(corners) {
            *to = corner.map(|v| v as f32);
            footprint.count += 1;
        }
        footprint
    }
}

/// The outline around an origin, without corners that are nearly the same.
fn outline(corners: &[[f64; 2]], [x_m, y_m]: [f64; 2]) -> Footprint {
    let apart = |a: &[f64; 2], b: &[f64; 2]| {
        (a[0] - b[0]).abs() > SAME_CORNER_M || (a[1] - b[1]).abs() > SAME_CORNER_M
    };
    let mut last = None;
    let is_new = |corner: &[f64; 2]| {
        let is_new = last.is_none_or(|last| apart(&last, corner));
        last = if is_new { Some(*corner) } else { last };
        is_new
    };
    let kept = Polygon::<FOOTPRINT_MAX>::new(corners.iter().copied().filter(is_new));
    let mut kept = kept.corners();
    while let [first, middle @ .., end] = kept
        && !apart(first, end)
    {
        kept = &kept[..middle.len() + 1];
    }
    Footprint::of_corners(kept.iter().map(|[x, y]| [x + x_m, y + y_m]))
}

/// Room for one more corner than the last cut leaves.
const CORNERS_MAX: usize = FOOTPRINT_MAX + 1;

#[cfg(test)]
mod tests {
    use super::*;

    fn corners(footprint: &Footprint) -> Vec<[f64; 2]> {
        let corners = &footprint.corners_m[..footprint.count];
        corners.iter().map(|c| c.map(f64::from)).collect()
    }

    fn area(footprint: &Footprint) -> f64 {
        Polygon::<FOOTPRINT_MAX>::new(corners(footprint)).area()
    }

    #[test]
    fn a_disc_becomes_sixteen_corners_around_every_point() {
        let mut points = ClusterPoints::default();
        for i in 0..1000 {
            let angle = f64::from(i) * 0.0071;
            points.push((5.0 + angle.cos()) as f32, (angle.sin() - 3.0) as f32, 0.0);
        }
        let found = Footprint::around(&points, &points.rectangle(0.3));
        assert_eq!(found.count, 16);
        let share = area(&found) / std::f64::consts::PI;
        assert!(share > 0.999 && share < 1.02, "{share}");
        let corners = corners(&found);
        for i in 0..points.len() {
            for k in 0..16 {
                let (a, b) = (corners[k], corners[(k + 1) % 16]);
                let p = [f64::from(points.x_m[i]), f64::from(points.y_m[i])];
                let side = (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
                assert!(side > -1e-5, "point {i} outside of side {k}");
            }
        }
    }

    #[test]
    fn a_triangle_keeps_its_slanted_side_and_lines_and_spots_have_an_area() {
        type Case = (&'static [[f32; 2]], f64, std::ops::Range<f64>);
        let cases: [Case; 4] = [
            (&[[0.0, 0.0], [2.0, 0.0], [0.0, 2.0]], 0.0, 1.9999..2.0001),
            (&[[1.0, 1.0]], 0.2, 3e-4..4e-4),
            (&[[1.0, 1.0], [2.0, 1.0]], 0.0, 0.02..0.021),
            (&[[0.0, 0.2341], [0.23428, 0.0]], 0.0, 6.6e-3..7.1e-3),
        ];
        for (places, yaw_rad, expected) in cases {
            let mut points = ClusterPoints::default();
            places.iter().for_each(|&[x, y]| points.push(x, y, 0.0));
            let found = Footprint::around(&points, &points.rectangle(yaw_rad));
            assert!(expected.contains(&area(&found)), "{places:?}: {found:?}");
            assert!(found.count == 3 || places.len() < 3, "{found:?}");
        }
    }
}
