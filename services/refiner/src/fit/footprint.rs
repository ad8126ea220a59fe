//! The outline of a cluster seen from above: convex, at most sixteen corners, around every point.
//!
//! The tight rectangle, cut by the supporting lines of twelve more directions. That is the convex hull up to its finest
//! corners, and never smaller, in time linear in the points. Points on a line or on one spot get an outline a
//! centimetre around them, so that it always is a polygon.

use mluc_ipc_types::FOOTPRINT_MAX;

use super::{ClusterPoints, Rectangle};

/// Directions within a quarter turn, the rectangle's own included: four times so many sides.
const DIRECTIONS: usize = FOOTPRINT_MAX / 4;
/// Corners closer than this are one, m.
const SAME_CORNER_M: f64 = 1e-3;
/// A rectangle thinner than this is an outline around a line, m,
const THIN_M: f64 = 0.02;
/// and is laid this far around it, m.
const AROUND_M: f64 = 0.01;

/// Corners counter-clockwise, relative to the points' origin, m, and how many of them are used.
pub fn footprint(
    points: &ClusterPoints,
    rectangle: &Rectangle,
) -> ([[f64; 2]; FOOTPRINT_MAX], usize) {
    let [u, v] = rectangle.size_m();
    let around_m = if u.min(v) < THIN_M { AROUND_M } else { 0.0 };
    let mut polygon = Polygon::of(&rectangle.grown(around_m));
    for step in 1..DIRECTIONS {
        let turn = std::f64::consts::FRAC_PI_2 * step as f64 / DIRECTIONS as f64;
        for quarter in 0..2 {
            let angle = rectangle.yaw_rad + turn + f64::from(quarter) * std::f64::consts::FRAC_PI_2;
            let (sin, cos) = angle.sin_cos();
            let [low, high] = points.span_m([cos as f32, sin as f32]).map(f64::from);
            polygon = polygon.cut([cos, sin], high + around_m);
            polygon = polygon.cut([-cos, -sin], around_m - low);
        }
    }
    polygon.without_doubles()
}

/// Room for one more corner than the last cut leaves.
const CORNERS_MAX: usize = FOOTPRINT_MAX + 1;

#[derive(Clone, Copy)]
struct Polygon {
    corners: [[f64; 2]; CORNERS_MAX],
    count: usize,
}

impl Polygon {
    fn of(r: &Rectangle) -> Polygon {
        let (sin, cos) = r.yaw_rad.sin_cos();
        let mut corners = [[0.0; 2]; CORNERS_MAX];
        let ends = [(1, 1), (0, 1), (0, 0), (1, 0)];
        for (corner, (u, v)) in corners.iter_mut().zip(ends) {
            let (u, v) = (r.u_m[u], r.v_m[v]);
            *corner = [u * cos - v * sin, u * sin + v * cos];
        }
        Polygon { corners, count: 4 }
    }

    fn push(&mut self, corner: [f64; 2]) {
        if self.count < CORNERS_MAX {
            self.corners[self.count] = corner;
            self.count += 1;
        }
    }

    /// The part where `normal . corner <= limit`. A line that would leave nothing, by rounding, cuts nothing.
    fn cut(&self, normal: [f64; 2], limit: f64) -> Polygon {
        let beyond = |c: [f64; 2]| c[0] * normal[0] + c[1] * normal[1] - limit;
        let mut kept = Polygon {
            corners: [[0.0; 2]; CORNERS_MAX],
            count: 0,
        };
        for i in 0..self.count {
            let (from, to) = (self.corners[i], self.corners[(i + 1) % self.count]);
            let (a, b) = (beyond(from), beyond(to));
            if a <= 0.0 {
                kept.push(from);
            }
            if (a < 0.0 && b > 0.0) || (a > 0.0 && b < 0.0) {
                let t = a / (a - b);
                kept.push([
                    from[0] + t * (to[0] - from[0]),
                    from[1] + t * (to[1] - from[1]),
                ]);
            }
        }
        if kept.count >= 3 { kept } else { *self }
    }

    fn without_doubles(&self) -> ([[f64; 2]; FOOTPRINT_MAX], usize) {
        let mut corners = [[0.0; 2]; FOOTPRINT_MAX];
        let mut count = 0;
        let apart = |a: [f64; 2], b: [f64; 2]| {
            (a[0] - b[0]).abs() > SAME_CORNER_M || (a[1] - b[1]).abs() > SAME_CORNER_M
        };
        for &corner in &self.corners[..self.count] {
            let is_new = count == 0 || apart(corners[count - 1], corner);
            if is_new && count < FOOTPRINT_MAX {
                corners[count] = corner;
                count += 1;
            }
        }
        while count > 1 && !apart(corners[0], corners[count - 1]) {
            count -= 1;
        }
        (corners, count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(corners: &[[f64; 2]]) -> f64 {
        (0..corners.len())
            .map(|i| {
                let (a, b) = (corners[i], corners[(i + 1) % corners.len()]);
                (a[0] * b[1] - a[1] * b[0]) / 2.0
            })
            .sum()
    }

    #[test]
    fn a_disc_becomes_sixteen_corners_around_every_point() {
        let mut points = ClusterPoints::default();
        for i in 0..1000 {
            let angle = f64::from(i) * 0.0071;
            points.push((5.0 + angle.cos()) as f32, (angle.sin() - 3.0) as f32, 0.0);
        }
        let (corners, count) = footprint(&points, &points.rectangle(0.3));
        assert_eq!(count, 16);
        let corners = &corners[..count];
        let outline = area(corners);
        assert!(
            outline > 0.999 * std::f64::consts::PI && outline < 1.02 * std::f64::consts::PI,
            "{outline}"
        );
        for i in 0..points.len() {
            for k in 0..count {
                let (a, b) = (corners[k], corners[(k + 1) % count]);
                let p = [f64::from(points.x_m[i]), f64::from(points.y_m[i])];
                let side = (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
                assert!(side > -1e-5, "point {i} outside of side {k}");
            }
        }
    }

    #[test]
    fn a_triangle_keeps_its_slanted_side() {
        let mut points = ClusterPoints::default();
        for [x, y] in [[0.0, 0.0], [2.0, 0.0], [0.0, 2.0]] {
            points.push(x, y, 0.0);
        }
        let (corners, count) = footprint(&points, &points.rectangle(0.0));
        assert!((area(&corners[..count]) - 2.0).abs() < 1e-5);
        assert_eq!(count, 3);
    }

    #[test]
    fn a_line_and_a_point_have_an_outline_of_a_centimetre() {
        let mut points = ClusterPoints::default();
        points.push(1.0, 1.0, 0.0);
        let (corners, count) = footprint(&points, &points.rectangle(0.2));
        let spot = area(&corners[..count]);
        assert!((3e-4..4e-4).contains(&spot), "{spot}");
        points.push(2.0, 1.0, 0.0);
        let (corners, count) = footprint(&points, &points.rectangle(0.0));
        let line = area(&corners[..count]);
        assert!((0.02..0.021).contains(&line), "{line}");
    }
}
