//! Convex polygons: clipping by half planes (Sutherland and Hodgman, 1974) and area.
//!
//! A rectangle clipped by the four sides of another one has at most eight corners, so everything lives in a fixed
//! buffer. Clipping is done in the other rectangle's own frame, where its sides are parallel to the axes: the
//! arithmetic stays near the origin, whatever the distance of the boxes from the sensor.

/// Four corners, and at most one more for each of four cuts.
const CORNERS_MAX: usize = 8;

/// A convex polygon of at most eight corners, in order.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Polygon {
    corners: [[f64; 2]; CORNERS_MAX],
    count: usize,
}

impl Polygon {
    /// From four corners in order.
    pub(crate) fn from_corners(corners: [[f64; 2]; 4]) -> Polygon {
        let mut polygon = Polygon {
            corners: [[0.0; 2]; CORNERS_MAX],
            count: 4,
        };
        polygon.corners[..4].copy_from_slice(&corners);
        polygon
    }

    fn push(&mut self, corner: [f64; 2]) {
        // Rounding could add a corner only to a polygon that is not convex; the area does not miss it then.
        if self.count < CORNERS_MAX {
            self.corners[self.count] = corner;
            self.count += 1;
        }
    }

    /// The part where `sign * coordinate[axis] <= limit`.
    pub(crate) fn clip(&self, axis: usize, sign: f64, limit: f64) -> Polygon {
        let mut kept = Polygon {
            corners: [[0.0; 2]; CORNERS_MAX],
            count: 0,
        };
        for i in 0..self.count {
            let (from, to) = (self.corners[i], self.corners[(i + 1) % self.count]);
            let (outside_from, outside_to) = (sign * from[axis] - limit, sign * to[axis] - limit);
            if outside_from <= 0.0 {
                kept.push(from);
            }
            if (outside_from < 0.0 && outside_to > 0.0) || (outside_from > 0.0 && outside_to < 0.0)
            {
                let t = outside_from / (outside_from - outside_to);
                kept.push([0, 1].map(|i| from[i] + t * (to[i] - from[i])));
            }
        }
        kept
    }

    /// Area by the shoelace formula, not negative.
    pub(crate) fn area(&self) -> f64 {
        let mut twice = 0.0;
        for i in 0..self.count {
            let (a, b) = (self.corners[i], self.corners[(i + 1) % self.count]);
            twice += a[0] * b[1] - a[1] * b[0];
        }
        twice.abs() / 2.0
    }
}
